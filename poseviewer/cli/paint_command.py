"""Paint the model from the photos of a scene, the keys of a sequence or the photo of a pose file,
and write it as GLB. Faces that no photo shows have the material ``unpainted``.
"""

from argparse import Namespace

from poseviewer.cli import options as table
from poseviewer.cli.terminal import say, tell_of_compiling
from poseviewer.errors import percent

OPTIONS = {
    "": (
        table.option("scene SCENE|POSE", "scene file or pose file"),
        table.option("out PAINTED.glb", "file to write", is_output=True),
        table.option("--model MODEL", "paint this model (default: the one in the pose file)"),
        table.option("--photo PHOTO", "paint from this photo (default: the one in the pose file)"),
        table.OBJECT,
        table.option("--overwrite", "replace files that exist"),
    )
}
EXAMPLES = (
    "poseviewer paint pose.json painted.glb",
    "poseviewer paint results/scene.json painted.glb --object duck",
)
OF_POSE = OPTIONS[""][2:4]


def run(options: Namespace) -> int:
    """Write the painted models, a file each."""
    from poseviewer.api import make_registration
    from poseviewer.files.formats.conversion import require_file, require_free
    from poseviewer.files.pose import load_pose
    from poseviewer.files.scene_assets import model_file
    from poseviewer.files.scene_json import scene_of_pose
    from poseviewer.opening.scenes import open_scene
    from poseviewer.opening.sources import Sources, is_scene_file

    path = options.scene
    if is_scene_file(path):
        table.refuse(options, OF_POSE, f"with {path.name}, which says it itself; leave it out")
        sources = Sources(scene=path)
    else:
        table.refuse(options, (table.OBJECT,), "with a pose file, which has one; leave it out")
        named = scene_of_pose(path, load_pose(path))
        model, photo = named.objects[0].model, options.photo or named.views[0].file.location
        if options.model is not None:
            model = model_file(options.model, model.sha256, model.unit)
        require_file(photo, "photo", "Painted")
        require_file(model.location, "model", "Painted")
        sources = Sources(photo, model=model, start=path)
    chosen = make_registration(open_scene(sources))
    chosen = chosen[options.object] if options.object else chosen
    require_free(chosen.painted_files(options.out), options.overwrite)
    tell_of_compiling()
    chosen = chosen.paint()
    for file in chosen.save_painted(options.out):
        say(f"painted: {file}")
    for item in (chosen.objects[index] for index in chosen.indices):
        if item.painting is not None:
            count = len(item.painting.photos)
            photos = "1 photo" if count == 1 else f"{count} photos"
            say(f"{item.label}: {percent(item.painting.share)} of the surface, from {photos}")
    return 0
