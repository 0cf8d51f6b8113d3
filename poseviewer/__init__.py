"""Register a known 3D model onto one photo."""
