"""Fit one pose to a set of photos, and to each alone: several_photos.py SET MODEL START.

SET says where the cameras stand: our set file, a COLMAP folder, transforms.json or a BOP scene.
START is a pose in one of the photos, which its file names.
"""

import sys

import numpy as np

import poseviewer

photos, model, start = sys.argv[1:]
result = poseviewer.load(photos, model, start).fit(threads=2, seconds=60)
print("all photos:", "no verdict" if result.verdict is None else result.verdict.label)

for alone in result.view_results:
    word = "not judged" if alone.verdict is None else alone.verdict.label
    print(f"{alone.view.name}: loss {alone.loss:.3f} at the common pose, {word}")

# The same search by the first photo alone tells less about the depth.
first = result.scene.views[0]
single = poseviewer.load(first.file.location, model, result.start.pose).fit(seconds=60)
for name, end in {"all photos": result, first.name: single}.items():
    depth = np.nan if end.covariance is None else end.covariance.deviations["depth"]
    print(f"{name}: the depth is known to {depth:.4g}")

result.save("result.scene.json")
result.draw("result.png")
