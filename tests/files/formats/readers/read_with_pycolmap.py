"""COLMAP's reader: MODEL_FOLDER POINTS.json PHOTO OUT.json, or MODEL_FOLDER POINTS.json OUT.json.

Writes where COLMAP sees the points, and where its own features lie in the photo; without a photo,
where each camera of the model sees the points of its own frame.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pycolmap  # pyright: ignore[reportMissingImports]

folder, points, *photo, out = sys.argv[1:]
model, points = pycolmap.Reconstruction(folder), np.array(json.loads(Path(points).read_text()))
if photo:
    (image,) = model.images.values()
    grey = pycolmap.Bitmap.read(*photo, as_rgb=False).to_array()
    keypoints, _ = pycolmap.Sift(device=pycolmap.Device.cpu).extract(grey)
    answer = {
        "name": image.name,
        "points": np.array([image.project_point(point) for point in points]).tolist(),
        "features": np.array(keypoints)[:, :2].tolist(),
        "size": [image.camera.width, image.camera.height],
    }
else:
    answer = {
        str(number): np.array([camera.img_from_cam(point) for point in points]).tolist()
        for number, camera in model.cameras.items()
    }
Path(out).write_text(json.dumps(answer))
