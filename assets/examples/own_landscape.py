"""Map a loss of your own about a pose, beside poseviewer's: own_landscape.py [PHOTO MODEL POSE]."""

import sys
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import poseviewer
from poseviewer.files.demo import demo_case

demo = demo_case()
centre = poseviewer.load(*(sys.argv[1:] or (demo.photo, demo.model, demo.truth)))
photo, place = centre.photo.as_float(), centre.pose.camera_from_model
steps = centre.mesh.diameter * np.linspace(-0.1, 0.1, 9)
shifts = [np.array([x, 0.0, z]) for z in steps for x in steps]
moved = [replace(place, translation=place.translation + shift) for shift in shifts]


def mean_difference(pose):
    """Compare colours of photo and model as they are: a loss that knows no light."""
    image = centre.renderer.render(pose)
    return np.abs(photo[image.mask] - image.reflectance[image.mask]).mean()


for name, loss in {"default": lambda pose: centre.at(pose).loss, "mean": mean_difference}.items():
    values = [loss(replace(centre.pose, camera_from_model=transform)) for transform in moved]
    row, column = divmod(int(np.argmin(values)), len(steps))
    plt.contourf(steps, steps, np.reshape(values, (9, 9)))
    plt.title(f"{name}: least at x {steps[column]:+.2f}, z {steps[row]:+.2f}")
    plt.savefig(f"{name}.png")
