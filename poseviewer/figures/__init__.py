"""Landscapes, benchmarks and studies, drawn for print. The only user of matplotlib."""
