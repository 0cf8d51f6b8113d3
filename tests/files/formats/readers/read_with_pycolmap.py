"""COLMAP's reader: MODEL_FOLDER POINTS.json PHOTO OUT.json.

Writes where COLMAP sees the points, and where its own features lie in the photo.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pycolmap  # pyright: ignore[reportMissingImports]

folder, points, photo, out = sys.argv[1:]
model = pycolmap.Reconstruction(folder)
(image,) = model.images.values()
seen = [image.project_point(np.array(point)) for point in json.loads(Path(points).read_text())]
grey = pycolmap.Bitmap.read(photo, as_rgb=False).to_array()
keypoints, _ = pycolmap.Sift(device=pycolmap.Device.cpu).extract(grey)
answer = {
    "name": image.name,
    "points": np.array(seen).tolist(),
    "features": np.array(keypoints)[:, :2].tolist(),
    "size": [image.camera.width, image.camera.height],
}
Path(out).write_text(json.dumps(answer))
