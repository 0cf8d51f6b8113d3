"""App in the browser, the only package that imports viser."""
