"""App in the browser, the only room that imports viser."""
