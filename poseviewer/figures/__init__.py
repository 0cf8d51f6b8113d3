"""Sheets of maps for print, and tables; the only package that imports matplotlib."""
