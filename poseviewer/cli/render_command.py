"""Write masks, depth, normals and object coordinates (NOCS) of all objects at their poses, in the
form of data sets.
"""

import json
from argparse import Namespace

from poseviewer.cli import options as table
from poseviewer.cli.terminal import say

OPTIONS = {
    "": (
        table.option("scene SCENE|POSE", "scene file or pose file"),
        table.option("--model MODEL", "render this model (default: the one in the pose file)"),
        table.option("--photo-size WIDTHxHEIGHT", "set the photo's size, in px (default: POSE's)"),
        table.option("--out FOLDER", "write the pictures here", required=True),
        table.option("--overwrite", "replace existing files"),
    )
}
EXAMPLES = (
    "poseviewer render pose.json --out maps",
    "poseviewer render shelf.scene.json --out maps --overwrite",
)


def run(options: Namespace) -> int:
    """Write the pictures, all or none."""
    from dataclasses import replace

    from poseviewer.figures.object_maps import pictures_of_objects, save_pictures
    from poseviewer.files.checks import InputFile
    from poseviewer.files.formats.bop import INFO
    from poseviewer.files.formats.conversion import ConvertOptions, require_file
    from poseviewer.files.mesh.size import distance_notes
    from poseviewer.files.pose import load_pose
    from poseviewer.files.scene_assets import model_file
    from poseviewer.files.scene_json import load_scene, scene_of_pose
    from poseviewer.opening.sources import is_scene_file

    path = options.scene
    scene = load_scene(path) if is_scene_file(path) else scene_of_pose(path, load_pose(path))
    request = ConvertOptions(photo_size=options.photo_size)
    views = [request.with_size(InputFile(path), view) for view in scene.views]
    scene = replace(scene, views=tuple(views))
    if options.model is not None:
        known = scene.objects[0].model
        model = model_file(options.model, known.sha256, known.unit)
        scene = replace(scene, objects=(replace(scene.objects[0], model=model),))
    for item in scene.objects:
        require_file(item.model.location, "model", "Rendered")
    pictures = pictures_of_objects(scene)
    save_pictures(options.out, pictures, options.overwrite)
    if any(view.file.undistortion is not None for view in scene.views):
        say("note: all pictures belong to the undistorted photo.")
    infos = json.loads(pictures[INFO]).values()
    for index, item in enumerate(scene.objects):
        if not any(of_image[index]["px_count_visib"] for of_image in infos):
            say(f"note: {item.model.name} is seen in no photo, and its masks are empty.")
        for note in distance_notes(item.mesh, scene.pose(index)):
            say(f"note: {item.model.name}: {note}")
    for folder in sorted({(options.out / name).parent for name in pictures}):
        say(f"render: {folder}")
    return 0
