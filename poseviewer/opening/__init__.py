"""One door: files that were named or dropped become sources, and these a scene."""
