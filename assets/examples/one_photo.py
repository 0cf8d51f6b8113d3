"""Fit a model to a photo: one_photo.py [PHOTO MODEL START], by default the bundled demo."""

import sys

import poseviewer
from poseviewer.files.demo import demo_case

demo = demo_case()
photo, model, start = sys.argv[1:] or (demo.photo, demo.model, demo.start)
registration = poseviewer.load(photo, model, start)
result = registration.fit(seconds=60)

print(result.status)
print(f"unexplained: {registration.unexplained:.3f} -> {result.unexplained:.3f}")
if result.verdict is not None:
    print(result.verdict.label, *result.verdict.reasons, sep="\n  ")
if result.covariance is not None:
    print("standard deviations:", result.covariance.words(result.mesh.unit))
print("camera from model:", result.pose.camera_from_model.translation)

result.save("pose.json")
for look in ("outline", "residual"):
    result.draw(f"{look}.png", look)
