"""How long an evaluation of a pose takes, on which path, and what of it; fits and maps as well."""
