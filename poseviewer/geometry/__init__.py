"""Pure maths: transforms, cameras, meshes, pose charts."""
