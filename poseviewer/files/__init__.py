"""Readers and writers of all files.

No other package opens a path. A file that cannot be read, used or written raises the error of what
was wanted: a PhotoFileError for a photo, a MeshFileError for a model or what stands beside
it, a CalibrationFileError for cameras, a FileSetError for files that came together, else a
PoseFileError.
"""
