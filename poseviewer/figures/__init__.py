"""Sheets of maps for print, and tables; the only room that imports matplotlib."""
