"""How far the verdict can be trusted: made from the trials of studies, and measured on them."""
