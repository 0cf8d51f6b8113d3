"""What runs in Blender's Python, in a process of its own: ``bpy`` and NumPy, nothing of ours."""
