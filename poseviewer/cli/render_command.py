"""Write masks, depth, normals and object coordinates (NOCS) of all objects at their poses, as data
sets want them.
"""

from argparse import Namespace

from poseviewer.cli import options as table
from poseviewer.cli.terminal import say

OPTIONS = {
    "": (
        table.option("scene SCENE|POSE"),
        table.option("--model MODEL", "of a pose file (the one beside it that it names)"),
        table.option("--out FOLDER", required=True),
        table.option("--overwrite", "replace files that are there"),
    )
}


def run(options: Namespace) -> int:
    """Write the pictures, all or none."""
    from msgspec import structs

    from poseviewer.figures.object_maps import pictures_of_objects, save_pictures
    from poseviewer.files.file_set import is_scene_file
    from poseviewer.files.formats.conversion import require_file
    from poseviewer.files.pose import load_pose
    from poseviewer.files.scene_json import load_scene, scene_of_pose

    path = options.scene
    scene = load_scene(path) if is_scene_file(path) else scene_of_pose(path, load_pose(path))
    if options.model is not None:
        model = structs.replace(scene.objects[0].model, file=str(options.model))
        scene = structs.replace(scene, objects=(structs.replace(scene.objects[0], model=model),))
    for item in scene.objects:
        require_file(item.path, "model", "Rendered")
    pictures = pictures_of_objects(scene)
    save_pictures(options.out, pictures, options.overwrite)
    if any(view.distortion is not None for view in scene.views):
        say("note: all pictures belong to the undistorted photo.")
    for folder in sorted({(options.out / name).parent for name in pictures}):
        say(f"render: {folder}")
    return 0
