"""Cameras as the tools of the field write them: one table of forms.

A file is a tree of mappings; each that has all keys of a form is a camera. A key that looks like a
lens and belongs to no form is an error that names the key.
"""

import math
import re
from collections.abc import Callable, Iterator, Sized
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.files.checks import MAX_PX, InputFile
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.frames import HALF_PIXEL, camera_from_integer_centres
from poseviewer.geometry.lens import COEFFICIENTS, Lens, LensModel

MAX_SKEW = 1e-6
MAX_DEPTH = 8
MAX_SHARED = 200_000
"""Values that hold for several cameras, counted for each: some ten for each are usual."""
ALIASES = {
    "matrix": "cameramatrix intrinsicmatrix intrinsicsmatrix camk mtx k m kmatrix matrix",
    "intrinsics": "intrinsic cameraintrinsics projectionparameters",
    "distortion": "distortioncoefficients distortioncoefficient distortioncoeffs distortioncoeff "
    "distortion distcoeffs distcoeff distcoefs distcoef dist d coeffs coefficients kc "
    "distortionparams distortionparameters distortions",
    "radial": "radialdistortion", "tangential": "tangentialdistortion",
    "imagesize": "imgsize resolution", "width": "imagewidth imgwidth",
    "height": "imageheight imgheight", "isfisheye": "fisheyemodel fisheye",
    "distortionmodel": "distortiontype", "model": "lensmodel", "cameramodel": "projectionmodel",
    "cx": "ppx", "cy": "ppy", "offsetx": "xoffset roix roixoffset cropx cropoffsetx windowx",
    "offsety": "yoffset roiy roiyoffset cropy cropoffsety windowy",
    "roi": "crop croproi cropwindow cropbox window sensorwindow regionofinterest",
}  # fmt: skip
"""Names of a camera's numbers, in small letters without ``_``; others keep their own."""
FIELDS = {a: name for name, aliases in ALIASES.items() for a in (name, *aliases.split())}
MODEL_FIELDS = ("distortionmodel", "model", "cameramodel")
"""Fields that name a lens model and nothing else, the surest first."""
NUMBERED = ("matrix", "distortion", "imagesize", "width", "height", *MODEL_FIELDS)
"""Fields whose names may end in a number, which tells the cameras of a file apart."""
WINDOW_SIDES = (
    ("offsetx", "x", "left", "x0"), ("offsety", "y", "top", "y0"), ("width", "w"), ("height", "h"),
)  # fmt: skip
"""Fields of a window of the sensor: its corner and its size."""
MERGED = ("matrix", "intrinsics", "distortion", "imagesize", "lens")
"""Mappings that say more of the camera that they stand in, if they are none themselves."""
UNNAMED = (
    "calibration", "camera", "camera_info", "intrinsics", "intrinsic_settings", "sensor", "sensors",
    "value", "ptr_wrapper", "data", "value0", "model",
)  # fmt: skip
"""Mappings whose names tell no cameras apart."""
LABELS = ("label", "file_path", "#name", "name", "intrinsicId", "id", "key", "type")
"""Keys of what an entry of a list is called."""
SHORT = "(?!.{64})"
"""Start of a pattern that tries all parts of a name: those in use have fewer letters."""
SIZE_WORDS = (
    "(?:image|img|im|frame|picture|photo|video|camera|cam|calibration|calib|captured|capture|"
    "original|orig|colou?r|rgb|raw|pixels?|px|resolution|res|sizes?|dimensions?|dims?)*"
)
SIZE_LIKE = re.compile(
    f"{SHORT}{SIZE_WORDS}(?P<side>width|height|cols|columns|rows|wh|hw|[xywh]|shape|){SIZE_WORDS}"
)
"""Names, in small letters without ``_``, of the pictures' width, height or both."""
SIZED = re.compile("size|dim|res|shape|photo|picture|image|img|frame")
"""Words without which a key like that names something else."""
SIDES: dict[str, str] = dict.fromkeys(("width", "cols", "columns", "w", "x"), "width")
SIDES |= dict.fromkeys(("height", "rows", "h", "y"), "height")
"""Sides by their names between the words of ``SIZE_LIKE``."""
MAYBE_SIZE = re.compile(
    r"(?!.*(board|square|pattern|pixel|win|marker|tile|grid|roi|crop|depth|corner|file))"
    r".*(size|resol|dimension|width|height|shape).*"
)
"""Names of what may be the size of the pictures."""
SIZES = ("width", "height", "imagesize")
MIN_SIDE_PX = 40
"""Side of a picture: chessboards have fewer squares."""
TYPED = ("Metashape", "Meshroom", "OpenSfM, OpenDroneMap")
"""Tools whose ``type`` or ``projection...`` is that of a lens."""
TYPE_LIKE = re.compile(r".*(type|model|lens|projection)")
"""Names, in small letters without ``_``, of what may name a lens model."""
OTHER_LENS = re.compile(
    r".*(fish|equi(dist|solid|rect)|omni|ucm|kannala|division|spher|stereographic|scaramuzza|ocam"
    r"|ftheta|panoram|cylind|superview|hyperview).*|mei|kb\d?|ds|fov|atan"
)
"""Names, likewise, of lens models but OpenCV's standard one."""
OF_CAMERA = re.compile("(camera|cam|lens|projection|distortion|undistortion|intrinsics?|)type")
"""Names, likewise, of what says a lens model, unless its word is one of ``ANY_CAMERA``."""
ANY_CAMERA = re.compile(
    r"(?i:camera|rgb|colou?r|gr[ae]y|mono|stereo|depth|infra|sensor|left|right|cam\b|^ir$)"
)
MAYBE_OPENCV = re.compile(r"fish|equidist|kannala|kb")
"""Parts of a lens model's name that may be OpenCV's fisheye, if the user says so."""
FISHEYE_LIKE = re.compile(r"fish|equidist|kannala")
"""Parts of a key that say of the numbers below it that they are a fisheye's."""
OPENCV_ORDER = "k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4"
COUNTS_OF_LENSES = (5, 8, 14)
"""Counts of OpenCV's coefficients that a list of anything else seldom has."""
OTHER_LETTERS = ("k1 k2 r1 r2", "r1 r2 t1 t2 r3")
"""OpenCV's first coefficients in the letters of REMODE and Pix4D, where a file has all of them."""
LENS_NAMES: dict[LensModel | None, str] = {
    "opencv": "plumbbob rationalpolynomial opencv fullopencv pinhole simplepinhole standard radtan "
    "radtan8 pinholeradtan pinholeradtan8 radialtangential brownconrady brown radial simpleradial "
    "perspective frame radial1 radial3 radialk1 radialk3 opencvstandard "
    "perspectiveprojwithdistortion",
    "fisheye": "fisheye equidistant equi pinholeequi opencvfisheye fisheyeopencv kannalabrandt "
    "kannalabrandt4 kannalabrandt8 kb4 kb8 fisheye4",
    None: "none rectified inversebrownconrady modifiedbrownconrady "
    "perspectiveprojwithoutdistortion",
}
"""OpenCV's model by the names of others; None: a pinhole, whose coefficients have to be 0."""
PINHOLES = ("pinhole", "simplepinhole", "perspective", "frame", "standard")
"""Names of a projection or a mode, with which a lens of either model may come."""
LENS_MODELS: dict[str, LensModel | None] = {
    name: model for model, names in LENS_NAMES.items() for name in names.split()
}
LENS_LIKE = re.compile(
    r"(?!num|estimate|.*(std|error|sigma|covar|model|type|distance|corner|intrinsic|limit))"
    r"(.*dist.*|.*coeff?(icient)?s?|kc|lens|kappa.*|(left|right)?d(left|right|\d*)|.*radial.*"
    r"|.*tangential.*|ftheta.*|latlong|equirectangular|.*fish.*|(?P<alone>[kpbs]\d|t[12]|skew|xi|alpha|beta|omega|w))"
)
"""Names, in small letters without ``_``, of what may be a lens; ``alone``: a number, no list."""
NOT_STANDARD = ("p1", "p2", "k5", "k6")
"""Names of coefficients, of which a fisheye of ``k1 k2 k3 k4`` has none."""
ASK_MODEL = "choose opencv or fisheye with `Calibration.lens_model`"
MAX_KEY = 64
"""Letters of the names that are looked at."""
HARMLESS = re.compile(
    r"w|h|r|t|q|x|y|z|id|index|.*(pose|rot|trans|extrin|rvec|tvec|quat|orient|angle|posit|locat|"
    r"matrix|imu|axis|gravity|heading|pitch|roll|yaw|alt|rectif|project|"
    r"size|width|height|resol|dimension|shape|row|col|pixel|pitch|sensor|crop|binning|roi|offset|"
    r"error|rms|std|sigma|covar|residual|uncert|variance|score|conf|accuracy|"
    r"board|square|marker|pattern|corner|point|grid|tag|"
    r"time|date|stamp|fps|rate|frame|expos|shutter|iso|gain|gamma|aperture|fnum|white|vignet|noise|"
    r"depth|baseline|bf|near|far|plane|scale|unit|scene|bound|aabb|fov|focal|radius|ratio|factor|"
    r"sharp|blur|bright|contrast|satur|hue|black|sensitiv|quality|weight|mean|median|min|max|mode|"
    r"temp|pressure|humid|gps|lat|lon|lng|dop|elev|azim|velocity|speed|accel|gyro|bias|"
    r"version|count|num|flag|seq|iter|level|thres|seed|serial|id|label|name|bit|channel|layer).*"
)
"""Names, in small letters without ``_``, of numbers of a camera that are none of its lens."""
SIDED = re.compile(SHORT + r"(left|right)?(.*?)(left|right|\d*)")
"""A name between what tells the cameras of a file apart."""


def _off_middle(cx: float, cy: float, size: tuple[int, int]) -> float:
    """Return the distance of a principal point from the middle of pictures, in their sides."""
    return abs(cx / (size[0] or 1) - 0.5) + abs(cy / (size[1] or 1) - 0.5)


@dataclass(frozen=True, slots=True)
class FileCamera:
    """A camera as a file has it."""

    name: str
    """Name among the file's cameras; "" where there is one alone."""
    camera: Perspective
    """Pixel centres at i + 0.5; 0x0 px where the file does not say the size of its pictures."""
    lens: Lens | None = None
    """None for a pinhole."""
    photos: frozenset[str] = frozenset()
    """File names of the photos it took, as far as the file says."""
    read: str = ""
    """Form and keys that it was read from."""
    is_of_stored: bool = False
    """Whether it is the camera of pixels as stored, whatever EXIF says."""


@dataclass(frozen=True, slots=True)
class _Fields:
    """Fields of a camera that a mapping has: of each the key as written, and the value."""

    file: InputFile
    entries: dict[str, tuple[str, Any]]
    photo: tuple[int, int]
    is_turned: bool = False
    """Whether width and height of the photo may change places."""
    above: dict[str, tuple[str, Any]] = field(default_factory=dict)
    """Fields of the mappings that it stands in, as far as they may say something of it."""
    used: dict[str, None] = field(default_factory=dict)

    def __contains__(self, name: str) -> bool:
        return name in self.entries

    def value(self, name: str, default: Any = None) -> Any:
        """The value of a field, which is marked as read."""
        key, value = self.entries.get(name, (name, default))
        if name in self.entries:
            self.used[key] = None
        return value

    def number(self, name: str, default: float | None = None) -> float:
        """A number."""
        return self.file.number(self.value(name, default), self.entries.get(name, (name,))[0])

    def numbers(self, name: str, count: int | None = None) -> list[float]:
        """Numbers in a list, a text or a mapping of x and y; [] where there is no such field."""
        value = self.value(name, [])
        if isinstance(value, dict) and "data" not in value:
            value = list(value.values())
        value = value if isinstance(value, dict | list | tuple | str) else [value]
        return self.file.flat_numbers(value, self.entries.get(name, (name,))[0], count)

    def model_words(self, form: "Form") -> Iterator[tuple[str, bool]]:
        """Iterate over words that may name the lens's model, the surest first, and if they do."""
        for fields in (self.entries, self.above):
            names = [n for n in fields if TYPE_LIKE.match(n) and n not in MODEL_FIELDS]
            for name in (*MODEL_FIELDS, *names):
                key, text = fields.get(name, ("", None))
                if isinstance(text, str) and text:
                    self.used[key] = None
                    is_sure = name in MODEL_FIELDS or form.tools in TYPED
                    is_sure |= bool(OF_CAMERA.fullmatch(name)) and not ANY_CAMERA.search(text)
                    is_sure &= fields is self.entries or name == MODEL_FIELDS[0]
                    yield text, is_sure

    @property
    def sizes(self) -> dict[str, Any]:
        """Both sides of the pictures by their keys, the mapping's or those above it."""
        fields = self.entries if not self.entries.keys().isdisjoint(SIZES) else self.above
        names = ("w", "h") if {"flx", "w", "h"} <= fields.keys() else ("width", "height")
        sides = [fields[name] for name in names if name in fields]
        ordered = {", ".join(key for key, _ in sides): [value for _, value in sides]}
        return (ordered if len(sides) == 2 else {}) | dict(fields.get("imagesize", ("", ()))[1])

    def size(self, cx: float = 0.0, cy: float = 0.0) -> tuple[int, int]:
        """Return width and height in px; ``cx`` and ``cy`` tell which number of a list is which."""
        sizes = {key: self._pair(key, value) for key, value in self.sizes.items()}
        for chosen in (sizes, {key: size for key, size in sizes.items() if "calib" in key.lower()}):
            if len({tuple(sorted(size)) for size in (chosen or sizes).values()}) < 2:
                key, size = next(iter((chosen or sizes).items()), ("", self.photo))
                break
        else:
            found = " and ".join(f"{w}x{h} px ({key})" for key, (w, h) in sizes.items())
            raise self.file.error(f"its pictures have {found}", "leave out all but one")
        self.used.update(dict.fromkeys([key] if key else []))
        off, off_turned = (_off_middle(cx, cy, own) for own in (size, (size[1], size[0])))
        is_open = ", " not in key if key else self.is_turned
        is_turned = is_open and bool(cx or cy) and off_turned < off
        return (size[1], size[0]) if is_turned else size

    def window(
        self, size: tuple[int, int], cx: float, cy: float
    ) -> tuple[int, int, tuple[int, int]]:
        """Return x and y (px) of the window of a sensor that the photo is, and its size.

        The principal point tells whether a camera of the window's size is that of the sensor.
        """
        keys, x, y, window = self._said_window(size)
        if not keys or (window != size == self.photo) or ((x, y) == (0, 0) and window == size):
            return 0, 0, size
        if 0 in window:
            wanted = "wanted image_width and image_height"
            raise self.file.error(f"{keys[0]!r} is of a window without size", wanted)
        if window == size and _off_middle(cx, cy, size) <= _off_middle(cx - x, cy - y, size):
            return 0, 0, size
        self.used.update(dict.fromkeys(keys))
        return x, y, window

    def _said_window(self, size: tuple[int, int]) -> tuple[list[str], int, int, tuple[int, int]]:
        """Return the keys of a window of the sensor, its corner, and its size."""
        key, said = self.entries.get("roi", ("", None))
        if isinstance(said, list) and len(numbers := _numbers_in(said)) == 4:
            x, y, right, bottom = map(int, numbers)
            for window in ((right, bottom), (right - x, bottom - y)):
                if window == self.photo:  # any other may be of the pixels that a lens leaves
                    return [key], x, y, window
        if isinstance(said, dict):
            keys, own = [key], {FIELDS.get(_plain(k), _plain(k)): n for k, n in said.items()}
        else:
            flat = {n: self.entries[n] for n in ("offsetx", "offsety") if n in self}
            keys, own = [k for k, _ in flat.values()], {n: value for n, (_, value) in flat.items()}
        x, y, *sides = (
            int(self.file.number(next((own[n] for n in names if n in own), 0), names[0], MAX_PX))
            for names in WINDOW_SIDES
        )
        if all(sides):
            return keys, x, y, (sides[0], sides[1])
        width, height = self.photo
        is_part = 0 < width <= size[0] - x and 0 < height <= size[1] - y
        return keys if x or y else [], x, y, self.photo if is_part else size

    def _pair(self, key: str, value: Any) -> tuple[int, int]:
        numbers = _numbers_in(value)
        numbers = numbers[:2] if len(numbers) == 3 and numbers[2] <= 4 else numbers  # of channels
        if len(numbers) != 2:
            raise self.file.error(f"{key} is {str(value)[:40]!r}", "wanted 2 numbers")
        width, height = (self.file.size(side, "image_size") or 0 for side in numbers)
        return width, height


@dataclass(frozen=True, slots=True)
class Form:
    """A form of cameras."""

    tools: str
    needs: tuple[str, ...]
    """Fields, all of which a camera of the form has."""
    pinhole: Callable[[_Fields], tuple[float, float, float, float]]
    """fx, fy, cx, cy in px."""
    shift: float = HALF_PIXEL
    """px from its pixel coordinates to ours: half a pixel where centres are at integers."""
    lens: str = OPENCV_ORDER
    """Names of its coefficients in OpenCV's order."""
    is_of_stored: bool = False
    """Whether it takes pixels as stored, and a lens of no model for OpenCV's standard one."""


def _from_middle(fields: _Fields, fx: float, fy: float, x: float, y: float) -> Any:
    """Return fx, fy, cx, cy of a principal point that counts from the picture's middle."""
    return fx, fy, fields.size()[0] / 2.0 + x, fields.size()[1] / 2.0 + y


def _of_matrix(fields: _Fields, name: str = "matrix") -> Any:
    key, value = fields.entries[name][0], fields.value(name)
    matrix = _matrix_of(fields.file, value, key)
    may_be_columns = isinstance(value, list) and len(value) == 9
    may_be_columns |= key.replace("_", "").lower() == "intrinsicmatrix"
    if may_be_columns and np.array_equal(matrix[:, 2], [0, 0, 1]):
        matrix = matrix.T
    camera = camera_of_matrix(fields.file, matrix.ravel().tolist(), key)
    shift = HALF_PIXEL + (key == "IntrinsicMatrix" or _is_matlab(fields))
    return camera.fx, camera.fy, camera.cx - shift, camera.cy - shift


def _is_matlab(fields: _Fields) -> bool:
    """Tell whether a camera is MATLAB's, which counts pixel centres from 1."""
    return fields.entries.get("radial", ("",))[0] == "RadialDistortion"


def _kalibr(fields: _Fields) -> Any:
    values = fields.numbers("intrinsics")
    return values if len(values) == 4 else _of_matrix(fields, "intrinsics")


def _of_names(fields: _Fields) -> Any:
    prefix = "fl" if "flx" in fields else "f"  # nerfstudio's second may be left out
    x, y = fields.number(f"{prefix}x"), fields.number(f"{prefix}y", fields.value(f"{prefix}x"))
    return x, y, fields.number("cx"), fields.number("cy")


def _metashape(fields: _Fields) -> Any:
    f = fields.number("f")
    return _from_middle(fields, f + fields.number("b1", 0.0), f, *map(fields.number, ("cx", "cy")))


def _meshroom(fields: _Fields) -> Any:
    """AliceVision's ``loadIntrinsic``; the principal point is absolute before version 1.2.1."""
    x, y = fields.numbers("principalpoint", 2)
    version = tuple(map(int, fields.numbers("version"))) or (1, 2, 5)
    if version < (1, 2, 1):
        x, y = x - fields.size()[0] / 2.0, y - fields.size()[1] / 2.0
    if version < (1, 2, 2):
        focals = fields.numbers("pxfocallength")
        return _from_middle(fields, focals[0], focals[-1], x, y)
    if fields.number("pixelratio", 1.0) != 1.0:
        raise fields.file.error("pixelRatio is not 1", "calibrate with square pixels")
    focal = fields.number("focallength") / fields.number("sensorwidth") * fields.size()[0]
    return _from_middle(fields, focal, focal, x, y)


def _fspy(fields: _Fields) -> Any:
    half = max(fields.size()) / 2.0
    (x, y), focal = fields.numbers("principalpoint", 2), fields.number("relativefocallength") * half
    return _from_middle(fields, focal, focal, x * half, -y * half)


def _reality_capture(fields: _Fields) -> Any:
    """Lengths are those on 35-mm film, whose 36 mm are the longer side."""
    px_per_mm = (max(fields.size()) or 1) / 36.0
    focal, x, y = (px_per_mm * fields.number(name) for name in ("f", "px", "py"))
    return _from_middle(fields, focal, focal, x, y)


def _visp(fields: _Fields) -> Any:
    fields.value("kdu")  # the lens undone, which the other direction says as well
    return tuple(fields.number(name) for name in ("px", "py", "u0", "v0"))


def _nerf(fields: _Fields) -> Any:
    focals, centre = [], []
    for side, axis in zip(fields.size(), "xy", strict=True):
        name, middle = f"cameraangle{axis}", 0.5 * side
        if name in fields:
            angle = fields.file.positive(fields.value(name), f"camera_angle_{axis}", math.pi)
            focals.append(middle / math.tan(0.5 * angle))
        centre.append(fields.number(f"c{axis}", middle))
    return focals[0], focals[-1], *centre


def _opensfm(fields: _Fields) -> Any:
    """Lengths count in longer sides."""
    f, unit = fields.value("focal"), max(fields.size())
    names = zip(("focalx", "focaly", "cx", "cy"), (f, f, 0.0, 0.0), strict=True)
    return _from_middle(fields, *(unit * fields.number(name, default) for name, default in names))


def _of_lists(fields: _Fields) -> Any:
    focals, centre = fields.numbers("focallength"), fields.numbers("principalpoint", 2)
    return focals[0], focals[-1], *(x - _is_matlab(fields) for x in centre)


FORMS = (
    Form("DepthAI", ("matrix", "cameratype", "lensposition"), _of_matrix),
    Form("OpenCV, ROS, BOP, Open3D, NumPy", ("matrix",), _of_matrix),
    Form("Kalibr", ("intrinsics",), _kalibr),
    Form("RealSense, BOP", ("fx", "fy", "cx", "cy"), _of_names),
    Form("nerfstudio", ("flx", "cx", "cy"), _of_names, 0.0, "k1 k2 p1 p2 k3", True),
    Form("RealityCapture", ("f", "px", "py"), _reality_capture, 0.0, "k1 k2 p1 p2 k3", True),
    Form("ViSP", ("px", "py", "u0", "v0"), _visp, lens="kud k2 p1 p2 k3"),
    Form("Metashape", ("f", "cx", "cy", "width"), _metashape, 0.0, "k1 k2 p2 p1 k3", True),
    *(Form("Meshroom", ("principalpoint", *focal, "width"), _meshroom, 0.0, is_of_stored=True)
      for focal in (("focallength", "sensorwidth"), ("pxfocallength",))),
    Form("fSpy", ("principalpoint", "relativefocallength", "width"), _fspy, 0.0),
    Form("OpenMVG", ("focallength", "principalpoint", "width"), _of_lists, is_of_stored=True),
    Form("MATLAB", ("focallength", "principalpoint", "imagesize"), _of_lists),
    *(Form("OpenSfM, OpenDroneMap", (*focal, "projectiontype"), _opensfm, 0.0, is_of_stored=True)
      for focal in (("focal",), ("focalx", "focaly"))),
    Form("NeRF", ("cameraanglex",), _nerf, 0.0, "k1 k2 p1 p2 k3", True),
)  # fmt: skip
"""Forms; the first of which a mapping has all keys is taken."""


READ = (
    ("OpenCV, NumPy, Pupil Labs, Pix4D, REMODE", ".yml .yaml .xml .json .npz",
     "camera_matrix, K, mtx, M1 ... or fx fy cx cy; distortion_coefficients, dist, D, kc ... or "
     "k1 k2 p1 p2 k3 ...; image_width, image_size, resX, DIM ..."),
    ("a 3x3 matrix", ".txt .npy .json", "fx 0 cx, 0 fy cy, 0 0 1"),
    ("ROS 1 and 2", ".yaml .txt .ini", "camera_info, ost.txt"),
    ("COLMAP", "cameras.txt cameras.bin", "all models that OpenCV has, pinhole to fisheye"),
    ("nerfstudio, NeRF", "transforms.json", "fl_x fl_y cx cy, is_fisheye; camera_angle_x"),
    ("BOP, NDDS, DOPE", ".json", "cam_K; camera.json, scene_camera.json, _camera_settings.json"),
    ("RealSense, Open3D, Record3D, DepthAI, Zivid", ".json", "coeffs; K by columns; cameraData"),
    ("Kalibr, Basalt", ".yaml .json", "camchain: radtan, equidistant; value0: pinhole, kb4"),
    ("ORB-SLAM 2 and 3", ".yaml", "Camera.fx ..., Camera1.fx ..., LEFT.K LEFT.D"),
    ("KITTI", "calib.txt calib_cam_to_cam.txt", "P0 ...; K_00 D_00 S_00 ..., P_rect_00 ..."),
    ("Middlebury", "calib.txt ..._par.txt", "cam0=[...]; a photo a line"),
    ("MATLAB", ".json", "cameraParameters: IntrinsicMatrix or K, RadialDistortion, ImageSize"),
    ("OpenSfM, OpenDroneMap", "reconstruction.json cameras.json", "perspective, brown, fisheye"),
    ("OpenMVG", "sfm_data.json", "pinhole, radial, brown, fisheye"),
    ("Metashape, Meshroom, RealityCapture, fSpy", ".xml .sfm .csv .json", "frames and fisheyes"),
    ("Gyroflow", ".json", "fisheye_params"),
    ("ViSP", ".xml .json", "px py u0 v0; kud"),
)  # fmt: skip


def cameras_in(
    file: InputFile, data: Any, lens_model: LensModel | None = None,
    photo: tuple[int, int] = (0, 0), is_turned: bool = False,
) -> list[FileCamera]:  # fmt: skip
    """Read all cameras in a tree.

    Args:
        file: the file that the tree is of.
        data: the tree.
        lens_model: OpenCV's model of the lens where the file does not say it.
        photo: width and height of the pictures (px) where the file does not say them.
        is_turned: whether these are those of pixels as stored, which EXIF turns by 90 degrees.

    Raises:
        PoseViewerError: there is none, a number makes no sense, a lens is of another model, of one
            that is not said, or is said by a key that no form has.
    """
    cameras = []
    known = list[tuple[Any, Any, bool]]()
    used = set[str]()
    is_sized = True
    if isinstance(data, list):
        data = {"cameras" if data and isinstance(data[0], dict) else "camera_matrix": data}
    for path, mapping, above in _mappings(_nest_dotted(data), (), MAX_DEPTH, {}):
        of_number, count = _entries_of(mapping), len(cameras)
        shared = of_number.get("", {}).copy()
        for name in ("matrix", "distortion"):
            shared.pop(name, None)
        cameras_here = {n: e for n, e in of_number.items() if n == "" or "matrix" in e}
        _check_shared(shared, len(cameras_here))
        for number, entries in cameras_here.items():
            own = _Fields(file, shared | entries if number else entries, photo, is_turned, above)
            form = next((form for form in FORMS if all(name in own for name in form.needs)), None)
            if form is not None:
                name = "-".join(part for part in (path, number) if part)
                fx, fy, cx, cy = form.pinhole(own)
                size = own.size(cx, cy)
                x, y, size = own.window(size, cx, cy)
                is_sized &= bool(own.sizes)
                camera = Perspective(fx, fy, cx - x + form.shift, cy - y + form.shift, *size)
                lens, photos = _lens(own, form, lens_model), {re.split(r"[/\\]", name)[-1]} - {""}
                read = f"{', '.join(own.used)} (as {form.tools})"
                more = frozenset(photos), read, form.is_of_stored
                cameras.append(FileCamera(name, camera, lens, *more))
                used |= own.used.keys()
        is_own = len(cameras) > count
        known += [(key, value, is_own) for key, value in mapping.items()]
    if not cameras:
        keys = ", ".join(str(key)[:20] for key in data) if isinstance(data, dict) else ""
        wanted = f"read are those of {', '.join(tools for tools, *_ in READ)}"
        wanted += "; the docs' page Cameras lists their keys"
        raise file.error(f"no camera in it (its keys: {keys[:80] or 'none'})", wanted)
    is_bare = len(cameras) == 1 and cameras[0].lens is None
    for key, value, is_own in known:
        plain, is_list = _plain(key), _is_matrix(value)
        if not is_sized and key not in used and MAYBE_SIZE.fullmatch(plain) and _sides(value):
            found = f"{key!r} may be the size of its pictures, and is not known here"
            raise file.error(found, "wanted image_width and image_height")
        if key in used or (plain == "w" and str(value).isdecimal()):
            continue
        if TYPE_LIKE.match(plain) and OTHER_LENS.fullmatch(_plain(value)):
            raise file.error(f"{key!r} is {str(value)[:40]!r}", "wanted it as distortion_model")
        like = LENS_LIKE.fullmatch(plain)
        is_word = "fish" in plain or plain == "lens"  # what stands for no number
        may_be = like and not (like["alone"] if is_list else is_word)
        if isinstance(value, dict) and not is_list:
            is_alone = is_own and used.isdisjoint(value) and not HARMLESS.fullmatch(plain)
            may_be = may_be or is_alone
            value = [n for k, n in value.items() if k not in used and not _is_harmless(k, n)]
        elif is_own or (is_bare and is_list and len(_numbers_in(value)) in COUNTS_OF_LENSES):
            may_be = may_be or not _is_harmless(key, value)
        if may_be and _is_number(value):
            wanted = "wanted distortion_coefficients, or k1, k2, p1, p2, k3 ..."
            wanted += "; if it is none, leave it out of a copy of the file"
            raise file.error(f"{key!r} may be a lens, and is not known here", wanted)
    return cameras


def _plain(key: Any) -> str:
    return re.sub(r"[_\s-]", "", str(key).lower())


def _nest_dotted(data: Any) -> Any:
    """Split ORB-SLAM's ``LEFT.K`` into mappings; size and type of ``Camera.`` are of all."""
    tree: dict[str, Any] = {}
    for key, value in data.items() if isinstance(data, dict) else ():
        head, _, name = str(key).partition(".")
        is_dotted = name and (_is_matrix(value) or not isinstance(value, dict))
        if is_dotted and isinstance(tree.setdefault(head, {}), dict):
            tree[head][name] = value
        if not is_dotted or (head == "Camera" and name in ("type", "width", "height")):
            tree[name if is_dotted else key] = value
    return tree or data


def _is_harmless(key: Any, value: Any) -> bool:
    """Tell whether an entry of a camera that no form reads is surely none of its lens."""
    plain = _plain(key)
    if isinstance(value, bool | dict) or len(plain) > MAX_KEY or HARMLESS.fullmatch(plain):
        return True
    numbers = _numbers_in(value)
    is_count = all(number >= 0.0 and number.is_integer() for number in numbers)
    return is_count or (_is_matrix(value) and len(numbers) in (9, 12, 16))


def _is_number(value: Any) -> bool:
    if isinstance(value, dict | list):
        return any(map(_is_number, value.get("data", []) if isinstance(value, dict) else value))
    with suppress(TypeError, ValueError):
        return bool(float(value))
    return False


def _check_shared(values: Sized, count: int) -> None:
    """Raise where values that hold for each of a ``count`` of cameras are too many in all."""
    if len(values) * count > MAX_SHARED:
        raise ValueError(f"{len(values):,} values that hold for each of {count:,} cameras")


def _is_pair(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and isinstance(value[1], dict)


def _is_matrix(value: Any) -> bool:
    if isinstance(value, dict):
        return not isinstance(value.get("data", {}), dict)
    return isinstance(value, list)


def _numbers_in(value: Any) -> list[float]:
    value = value.get("data", "") if isinstance(value, dict) else value
    return [float(number) for number in re.findall(r"-?\d+(?:\.\d*)?(?:e[-+]?\d+)?", str(value))]


def _sides(value: Any) -> list[float]:
    """A side of a picture, or both, in px; none where a value is of something else."""
    numbers = _numbers_in(value)
    sides = numbers[:2] if len(numbers) < 3 or (len(numbers) == 3 and numbers[2] <= 4) else []
    return sides if all(side >= MIN_SIDE_PX and side.is_integer() for side in sides) else []


def _size_field(plain: str, value: Any) -> str:
    """The field of a size that a key names; "" of a key of something else."""
    name, match = FIELDS.get(plain, ""), SIZE_LIKE.fullmatch(plain)
    if name in SIZES or not match:
        return name if name in SIZES else ""
    sides = _sides(value)
    side = SIDES.get(match["side"], "")
    is_size = SIZED.search(plain)
    if side and len(sides) == 1 and (is_size or match["side"] not in "xy"):
        return side
    return "imagesize" if is_size and not side and len(sides) == 2 else ""


def _pick_sides(key: Any, value: Any) -> list[Any]:
    """Width and height in a mapping that a key names as the size of pictures, or nothing."""
    plain = _plain(key)
    if not (isinstance(value, dict) and SIZE_LIKE.fullmatch(plain) and SIZED.search(plain)):
        return []
    sides = {_size_field(f"size{_plain(name)}", side): side for name, side in value.items()}
    is_camera = any(FIELDS.get(_plain(name)) == "matrix" or name == "fx" for name in value)
    return [] if is_camera else [sides[n] for n in ("width", "height") if n in sides]


def _mappings(
    node: Any, path: tuple[str, ...], depth: int, above: dict[str, tuple[str, Any]]
) -> Iterator[tuple[str, dict[str, Any], dict[str, tuple[str, Any]]]]:
    """Iterate over mappings with their names and the fields ``above`` them."""
    if not isinstance(node, dict) or not depth:
        return
    entries, inner = {}, []
    lists = {name: own for name, own in node.items() if isinstance(own, list) and own}
    sizes = {n: own for n, own in lists.items() if _size_field(_plain(n), own[0])}  # Basalt's
    _check_shared(sizes, sum(len(own) for own in lists.values() if isinstance(own[0], dict)))
    for key, value in node.items():
        if isinstance(value, list) and value and all(map(_is_pair, value)):
            value = {str(name): own for name, own in value}  # DepthAI's cameras by their sockets
        is_mapping, field_name = isinstance(value, dict) and not _is_matrix(value), _plain(key)
        field_name = FIELDS.get(field_name, field_name)
        is_base = key == "value0" and isinstance(value, dict) and "principal_point" in value
        if len(sides := _pick_sides(key, value)) == 2:
            both = dict(zip(("width", "height"), sides, strict=True))
            is_field = field_name == "imagesize"
            entries |= {n: entries.get(n, both[n]) for n in both} if is_field else {key: sides}
        elif isinstance(value, dict) and is_mapping and (is_base or field_name in MERGED):
            entries |= {k: v for k, v in value.items() if not isinstance(v, dict)}
            inner += [(k, v) for k, v in value.items() if isinstance(v, dict)]
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            adjusted = [one for one in value if one.get("class") == "adjusted"]
            is_frame = key == "frames"  # of nerfstudio's, some say cameras of their own
            shared = node if is_frame else ("version",)
            more = {k: node[k] for k in shared if k != key and k in node}
            all_ones = enumerate(adjusted or value)
            ones = [(at, one) for at, one in all_ones if not is_frame or "fl_x" in one]
            _check_shared(more, len(ones))
            beside = [(n, own) for n, own in sizes.items() if n != key and len(own) == len(value)]
            for number, one in ones:
                pairs = {n: own[number] for n, own in beside if _size_field(_plain(n), own[number])}
                label = next((one[k] for k in LABELS if k in one), number)
                inner.append((label, more | pairs | one))
        else:
            entries[key] = value
            inner += [(key, value)] * is_mapping
    yield next((part for part in reversed(path) if part not in UNNAMED), ""), entries, above
    own = _entries_of(entries).get("", {}).items()
    own = {n: e for n, e in own if TYPE_LIKE.match(n) or n in ("isfisheye", *SIZES)}
    above = {n: e for n, e in above.items() if n not in SIZES or own.keys().isdisjoint(SIZES)} | own
    _check_shared(above, len(inner))
    for key, value in inner:
        named = {"named": (str(key), True)} if FISHEYE_LIKE.search(_plain(key)) else {}
        yield from _mappings(value, (*path, str(key).strip()), depth - 1, above | named)


def _entries_of(mapping: dict[str, Any]) -> dict[str, dict[str, tuple[str, Any]]]:
    of_number: dict[str, dict[str, tuple[str, Any]]] = {}
    prefix = "cam" if "cam_fx" in mapping else ""  # REMODE's
    for key, value in mapping.items():
        plain = _plain(key).removeprefix(prefix)
        if value in (None, []):
            continue
        name, number = _size_field(plain, value) or FIELDS.get(plain, plain), ""
        parts = SIDED.fullmatch(plain)
        stem = parts[2] if parts else plain
        if stem != plain and FIELDS.get(stem) in NUMBERED and (_is_matrix(value) or len(stem) > 1):
            name, number = FIELDS[stem], plain.replace(stem, "", 1)
        like = LENS_LIKE.fullmatch(plain)
        if like and like["alone"] and not number and _is_matrix(value):
            continue  # OpenCV's P1 is a projection
        if FISHEYE_LIKE.search(plain) and _is_matrix(value) and name != "matrix":
            of_number.setdefault(number, {})["named"] = (str(key), True)
            name = "distortion"
        if name == "matrix" and not (_is_matrix(value) or isinstance(value, str)):
            continue  # an object named k may be a camera itself
        if name == "imagesize":
            of_number.setdefault(number, {}).setdefault(name, ("", []))[1].append((str(key), value))
        else:
            of_number.setdefault(number, {}).setdefault(name, (str(key), value))
    return of_number


def _lens_model(
    fields: _Fields, form: Form, asked: LensModel | None
) -> tuple[bool, LensModel | None]:
    """Tell whether the file says the model of a lens, and which; None: it has to have none."""
    marks = [f["isfisheye"] for f in (fields.entries, fields.above) if "isfisheye" in f]
    marks = [(key, mark) for key, mark in marks if not isinstance(mark, dict | list)]
    fields.used.update(dict.fromkeys(key for key, _ in marks))
    if any(str(mark).lower().rstrip(".0") in ("1", "true") for _, mark in marks):
        return True, "fisheye"
    if form.tools == "DepthAI":
        number = fields.number("cameratype")
        if number not in (0, 1):
            found = f"its cameraType is {number:g}"
            raise fields.file.error(found, "wanted 0, perspective, or 1, fisheye")
        return True, "fisheye" if number else "opencv"
    for text, is_sure in fields.model_words(form):
        plain = _plain(text).removeprefix("distortion.")
        if plain in LENS_MODELS and plain not in PINHOLES:
            if LENS_MODELS[plain] or is_sure:
                return True, LENS_MODELS[plain]
        elif OTHER_LENS.fullmatch(plain) or (is_sure and plain not in PINHOLES):
            is_other = OTHER_LENS.fullmatch(plain) and not MAYBE_OPENCV.search(plain)
            if asked and not is_other:
                continue
            wanted = "wanted OpenCV's standard or fisheye model"
            wanted += "" if is_other else f"; if it is one of them, {ASK_MODEL}"
            raise fields.file.error(f"its lens model is {text[:40]!r}", wanted)
    if "named" in fields or "named" in fields.above:
        return True, "fisheye"
    return bool(marks), "opencv"


def _lens(fields: _Fields, form: Form, asked: LensModel | None) -> Lens | None:
    is_said, model = _lens_model(fields, form, asked)
    if asked not in (None, model) and is_said:
        found = f"its lens is said to be of the model {model or 'none'!r}"
        raise fields.file.error(found, f"lens model {asked!r} is for files that do not say it")
    is_said, model = (True, asked) if asked else (is_said, model)
    if "distortion" in fields:
        values = fields.numbers("distortion")
        is_clear = len(values) != 4
        if form.tools == "Meshroom" and model == "opencv" and any(values):
            if len(values) not in (1, 3):
                raise fields.file.error("a lens of Meshroom's Brown model", "wanted radial3")
            k1, k2, k3 = [*values, 0.0, 0.0][:3]
            values = [k1, k2, 0.0, 0.0, k3]
    elif form.tools == "OpenMVG":
        names = (name for name in ("distok1", "distok3", "distot2") if name in fields)
        k1, k2, k3, t1, t2 = [*fields.numbers(next(names, "")), *[0.0] * 5][:5]
        values, is_clear = [k1, k2, t1, t2, k3], True
    elif "radial" in fields:
        k1, k2, *k3 = fields.numbers("radial")
        values, is_clear = [k1, k2, *(fields.numbers("tangential") or [0.0, 0.0]), *k3], True
    else:
        others = (own for own in OTHER_LETTERS if all(name in fields for name in own.split()))
        order = "k1 k2 k3 k4" if model == "fisheye" else next(others, form.lens)
        order = order.split()
        values = [fields.number(name, 0.0) for name in order]
        count = next(count for count in (5, 8, 12) if not any(values[count:]))
        values = values[:count] if any(name in fields for name in order) else []
        is_clear = "k4" not in fields or any(name in fields for name in NOT_STANDARD)
    if any(values) and not (is_said or is_clear or form.is_of_stored):
        found = "nothing says of which lens model its four distortion coefficients are"
        raise fields.file.error(found, ASK_MODEL)
    if model == "fisheye" and not any(values[4:]):
        values = values[:4] or [0.0] * 4
    elif not any(values):
        return None
    if model is None:
        text = next((text for text, is_sure in fields.model_words(form) if is_sure), "none")
        found = f"a lens of the model {text!r} with coefficients other than 0"
        raise fields.file.error(found, "wanted OpenCV's standard or fisheye model")
    if len(values) not in COEFFICIENTS[model]:
        known = "fisheye" if model == "fisheye" else "standard"
        wanted = f"OpenCV's {known} model has {', '.join(map(str, COEFFICIENTS[model]))}"
        raise fields.file.error(f"{len(values)} distortion coefficients", wanted)
    return Lens(model, tuple(values))


def _matrix_of(file: InputFile, value: Any, what: str) -> NDArray[np.float64]:
    values = file.flat_numbers(value, what)
    if len(values) == 16:  # a 4x4 matrix of which the last row and column say nothing
        whole = np.reshape(values, (4, 4))
        if np.array_equal(whole[3], [0, 0, 0, 1]) and not whole[:3, 3].any():
            values = whole[:3, :3].reshape(-1).tolist()
    if len(values) != 9:
        raise file.error(f"{what} has {len(values)} numbers", "wanted a 3x3 camera matrix")
    return np.reshape(values, (3, 3))


def camera_of_matrix(file: InputFile, value: Any, what: str) -> Perspective:
    """Return the pinhole of 0x0 px (centres at i + 0.5) of a 3x3 matrix (at integers)."""
    matrix = _matrix_of(file, value, what)
    fx, fy = (file.positive(float(matrix[i, i]), f"{what}: f{'xy'[i]}") for i in range(2))
    if not np.allclose(matrix[2], [0.0, 0.0, 1.0]) or abs(matrix[1, 0]) > MAX_SKEW * fx:
        found = f"{what} is {matrix.ravel().tolist()}"
        raise file.error(found, "wanted rows fx 0 cx, 0 fy cy, 0 0 1")
    if abs(matrix[0, 1]) > MAX_SKEW * fx:
        raise file.error(f"{what} has a skew of {matrix[0, 1]:g}", "calibrate without skew")
    camera = Perspective(fx, fy, float(matrix[0, 2]), float(matrix[1, 2]), 0, 0)
    return camera_from_integer_centres(camera)
