"""The only room that opens a path.

Where a file cannot be read, used or written, a function raises the PoseViewerError of what was
wanted: a PhotoFileError for a photo, a MeshFileError for a model or what stands beside it, a
CalibrationFileError for cameras, a FileSetError for files that came together, else a PoseFileError.
"""
