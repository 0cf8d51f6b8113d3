"""Landscapes drawn for print, and tables. The only user of matplotlib."""
