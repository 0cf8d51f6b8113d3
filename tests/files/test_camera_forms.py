"""Cameras as tools of the field write them, the same one in each form."""

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from poseviewer.errors import CalibrationFileError
from poseviewer.files.camera_forms import cameras_in
from poseviewer.files.cameras import Calibration, load_calibration, load_cameras
from poseviewer.files.checks import InputFile
from poseviewer.geometry.lens import Lens, opencv_matrix
from tests.writing import write

K = [[500.0, 0.0, 321.0], [0.0, 510.0, 239.0], [0.0, 0.0, 1.0]]
FLAT, FOCALS = [*K[0], *K[1], *K[2]], {"fx": 500, "fy": 510, "cx": 321, "cy": 239}
MATLAB = [[500.0, 0.0, 0.0], [0.0, 510.0, 0.0], [322.0, 240.0, 1.0]]
"""By columns; pixel centres count from 1."""
SIZE = {"width": 640, "height": 480}
BROWN = (-0.3, 0.1, 0.001, -0.001, 0.02)
NAMED = dict(zip(("k1", "k2", "p1", "p2", "k3"), BROWN, strict=True))
FISHEYE = (0.02, -0.01, 0.003, -0.001)
FOUR = dict(zip(("k1", "k2", "k3", "k4"), FISHEYE, strict=True))
YAML = "camera_matrix:\n- [500, 0, 321]\n- [0, 510, 239]\n- [0, 0, 1]\n"
LENS = Lens("opencv", BROWN)


def saved(**arrays: Any) -> bytes:
    memory = BytesIO()
    np.savez(memory, **arrays)
    return memory.getvalue()


def array(values: Any) -> bytes:
    memory = BytesIO()
    np.save(memory, values)
    return memory.getvalue()


FORMS: dict[str, tuple[str, Any, Lens | None]] = {
    "matrix and dist": ("a.json", {"K": K, "dist": BROWN, **SIZE}, LENS),
    "fisheye said": ("a.json", {"K": K, "D": FISHEYE, "fisheye": True}, Lens("fisheye", FISHEYE)),
    "kc": ("a.json", {"K": K, "kc": [BROWN], **SIZE}, LENS),
    "coefs": ("a.json", {"mtx": FLAT, "dist_coefs": BROWN}, LENS),
    "named in a lens": ("a.json", {**FOCALS, "lens": NAMED}, LENS),
    "named in a distortion": ("a.json", {"intrinsics": FOCALS, "distortion": NAMED}, LENS),
    "radial and tangential": (
        "a.json", {"IntrinsicMatrix": MATLAB, "RadialDistortion": [-0.3, 0.1, 0.02],
                   "TangentialDistortion": [0.001, -0.001]}, LENS),
    "intrinsics of nine": ("a.json", {"intrinsics": FLAT, "distortion": BROWN}, LENS),
    "rational": ("a.json", {**FOCALS, "k1": 0.1, "k6": 0.3},
                 Lens("opencv", (0.1, 0, 0, 0, 0, 0, 0, 0.3))),
    "remode": ("a.yaml", "".join(f"cam_{key}: {value}\n" for key, value in {
        **FOCALS, **SIZE, "k1": -0.3, "k2": 0.1, "r1": 0.001, "r2": -0.001}.items()),
        Lens("opencv", BROWN[:4])),
    "pix4d": ("a.json", {**FOCALS, "R1": -0.3, "R2": 0.1, "R3": 0.02, "T1": 0.001, "T2": -0.001},
              LENS),
    "visp": ("a.xml", "<root><camera><name>front</name><image_width>640</image_width>"
             "<image_height>480</image_height><model><type>perspectiveProjWithDistortion</type>"
             "<px>500</px><py>510</py><u0>321</u0><v0>239</v0><kud>-0.3</kud><kdu>0.33</kdu>"
             "</model></camera></root>", Lens("opencv", (-0.3, 0.0, 0.0, 0.0, 0.0))),
    "visp, json": ("cam.json", {"px": 500, "py": 510, "u0": 321, "v0": 239, "h": 480, "w": 640,
                                "model": "perspectiveProjWithoutDistortion", "depthScale": 0.001},
                   None),
    "a matrix alone": ("K.json", K, None),
    "open3d": ("a.json", {"intrinsic_matrix": np.array(K).T.reshape(-1).tolist()}, None),
    "realsense": ("a.json", {"fx": 500, "fy": 510, "ppx": 321, "ppy": 239,
                             "model": "distortion.brown_conrady", "coeffs": BROWN}, LENS),
    "realsense, inverse without lens": (
        "a.json", {**FOCALS, "model": "inverse_brown_conrady", "coeffs": [0] * 5}, None),
    "ros 1": ("a.yaml", "image_width: 640\nimage_height: 480\ncamera_name: front\ncamera_matrix:\n"
              "  rows: 3\n  cols: 3\n  data: [500, 0, 321, 0, 510, 239, 0, 0, 1]\n"
              "distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n"
              "  data: [-0.3, 0.1, 0.001, -0.001, 0.02]\n", LENS),
    "ros 2": ("a.yaml", "k: [500, 0, 321, 0, 510, 239, 0, 0, 1]\nd: [0.02, -0.01, 0.003, -0.001]\n"
              "distortion_model: equidistant\n---\n", Lens("fisheye", FISHEYE)),
    "an equidistant lens of zeros": (
        "a.yaml", YAML + "distortion_model: equidistant\nD: [0, 0, 0, 0]\n",
        Lens("fisheye", (0.0, 0.0, 0.0, 0.0))),
    "kalibr": ("a.yaml", "cam0:\n  camera_model: pinhole\n  distortion_coeffs: [0.02, -0.01, 0.003,"
               " -0.001]\n  distortion_model: equidistant\n  intrinsics: [500, 510, 321, 239]\n"
               "  resolution: [640, 480]\n  T_cam_imu:\n  - [1, 0, 0, 0]\n",
               Lens("fisheye", FISHEYE)),
    "nerfstudio": ("a.json", {"fl_x": 500, "fl_y": 510, "cx": 321.5, "cy": 239.5, "w": 640,
                              "h": 480, "camera_model": "OPENCV", **NAMED, "k4": 0}, LENS),
    "instant-ngp": ("a.json", {"fl_x": 500, "fl_y": 510, "cx": 321.5, "cy": 239.5,
                               "is_fisheye": True, "k1": 0.02, "k2": -0.01, "k3": 0.003,
                               "k4": -0.001}, Lens("fisheye", FISHEYE)),
    "metashape": ("a.xml", "<calibration><projection>frame</projection><width>640</width>"
                  "<height>480</height><f>510</f><cx>1.5</cx><cy>-0.5</cy><b1>-10</b1>"
                  "<k1>-0.3</k1><k2>0.1</k2><k3>0.02</k3><p1>-0.001</p1><p2>0.001</p2>"
                  "</calibration>", LENS),
    "orb-slam": ("a.yaml", "%YAML:1.0\nCamera.fx: 500.0\nCamera.fy: 510.0\nCamera.cx: 321.0\n"
                 "Camera.cy: 239.0\nCamera.k1: -0.3\nCamera.k2: 0.1\nCamera.p1: 0.001\n"
                 "Camera.p2: -0.001\nCamera.k3: 0.02\nCamera.fps: 30.0\n", LENS),
    "camodocal": ("a.yaml", "%YAML:1.0\n---\nmodel_type: PINHOLE\nimage_width: 640\n"
                  "image_height: 480\ndistortion_parameters:\n   k1: -0.3\n   k2: 0.1\n"
                  "   p1: 0.001\n   p2: -0.001\n   k3: 0.02\nprojection_parameters:\n"
                  "   fx: 500\n   fy: 510\n   cx: 321\n   cy: 239\n", LENS),
    "blocks": ("a.yaml", "K:\n-\n  - 500.0\n  - 0.0\n  - 321.0\n- [0, 510, 239]\n- - 0\n  - 0\n"
               "  - 1\ndist:\n- -0.3\n- .1\n- 1e-3\n- -1.e-3\n- '0.02'\n", LENS),
    "anchors, tags and flows": (
        "a.yml", "%YAML:1.0\nrow: &z [0, 0, 1]\nK: !!opencv-matrix\n  {rows: 3, cols: 3, dt: d, "
        "data: [500, 0, 321, 0, 510, 239, 0, 0, 1]}\n"
        "D: {data: [-0.3, 0.1, 0.001, -0.001, 0.02]}\n", LENS),
    "a date and a second document": (
        "a.yml", "date: 2024-01-02\n" + YAML + "dist: [-0.3, 0.1, 0.001, -0.001, 0.02]\n---\n"
        "K: 1\n", LENS),
    "no blanks": ("a.yaml", "%YAML:1.0\nK:[500, 0, 321, 0, 510, 239, 0, 0, 1]\nD: !!opencv-matrix\n"
                  "   rows:1\n   data:[ -0.3, 0.1, 0.001, -0.001, 0.02 ]\nfps:30\n", LENS),
    "orb-slam 3": ("a.yaml", "%YAML:1.0\nCamera.type: \"PinHole\"\nCamera1.fx: 500.0\n"
                   "Camera1.fy: 510.0\nCamera1.cx: 321.0\nCamera1.cy: 239.0\nCamera1.k1: -0.3\n"
                   "Camera1.k2: 0.1\nCamera1.p1: 0.001\nCamera1.p2: -0.001\nCamera1.k3: 0.02\n"
                   "Camera.width: 640\nCamera.height: 480\n", LENS),
    "kitti": ("calib.txt", "".join(f"P{i}: 500 0 321 {-9 * i} 0 510 239 0 0 0 1 0\n"
                                   for i in range(3)) + "Tr: 0 -1 0 0 0 0 -1 0 1 0 0 0\n", None),
    "kitti, raw": ("calib_cam_to_cam.txt", "calib_time: 09-Jan-2012 13:57:47\n"
                   "corner_dist: 9.950000e-02\nS_00: 6.400000e+02 4.800000e+02\n"
                   "K_00: 500 0 321 0 510 239 0 0 1\nD_00: -0.3 0.1 0.001 -0.001 0.02\n"
                   "R_00: 1 0 0 0 1 0 0 0 1\nS_rect_00: 1242 375\n"
                   "P_rect_00: 7 0 6 0 0 7 1 0 0 0 1 0\n", LENS),
    "middlebury": ("calib.txt", "cam0=[500 0 321; 0 510 239; 0 0 1]\ncam1=[500 0 321; 0 510 239; "
                   "0 0 1]\ndoffs=0\nbaseline=193.001\nwidth=640\nheight=480\nndisp=280\n", None),
    "middlebury, photos": ("a_par.txt", "2\nq.png 9 0 1 0 9 1 0 0 1 1 0 0 0 1 0 0 0 1 0 0 -.5\n"
                           "p.png 500 0 321 0 510 239 0 0 1 1 0 0 0 1 0 0 0 1 0 0 -.5\n", None),
    "ros, ost": ("ost.txt", "# oST version 5.0 parameters\n\n[image]\n\nwidth\n640\n\nheight\n480\n"
                 "\n[narrow_stereo]\n\ncamera matrix\n500 0 321\n0 510 239\n0 0 1\n\ndistortion\n"
                 "-0.3 0.1 0.001 -0.001 0.02\n\nrectification\n1 0 0\n0 1 0\n0 0 1\n\nprojection\n"
                 "500 0 321 0\n0 510 239 0\n0 0 1 0\n", LENS),
    "mvsnet": ("cam.txt", "extrinsic\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n\nintrinsic\n500 0 321\n"
               "0 510 239\n0 0 1\n\n425 2.5\n", None),
    "depthai": ("a.json", {"boardName": "OAK-D", "cameraData": [[0, {
        "cameraType": 0, "distortionCoeff": [*BROWN, *[0] * 9], "extrinsics": {"toCameraSocket": 1},
        "intrinsicMatrix": K, "lensPosition": 0, "specHfovDeg": 68.8, **SIZE}]]},
        Lens("opencv", (*BROWN, *[0] * 9))),
    "depthai, fisheye": ("a.json", {"cameraData": [[2, {
        "cameraType": 1, "distortionCoeff": [*FISHEYE, *[0] * 10], "intrinsicMatrix": K,
        "lensPosition": 0, **SIZE}]]}, Lens("fisheye", FISHEYE)),
    "record3d": ("metadata", {"K": [500, 0, 0, 0, 510, 0, 321, 239, 1], "w": 640, "h": 480,
                              "dw": 192, "dh": 256, "cameraType": 1,
                              "frameTimestamps": [1, 2, 3, 4, 5], "initPose": [0] * 7,
                              "poses": [[0, 0, 0, 1, 0, 0, 0]] * 5,
                              "perFrameIntrinsicCoeffs": [[500, 510, 321, 239]] * 5}, None),
    "zivid": ("a.json", {"CameraMatrix": {"CX": 321, "CY": 239, "FX": 500, "FY": 510},
                         "Distortion": {key.upper(): value for key, value in NAMED.items()}}, LENS),
    "matlab": ("a.json", {"FocalLength": [500, 510], "PrincipalPoint": [322, 240],
                          "ImageSize": [480, 640], "RadialDistortion": [-0.3, 0.1, 0.02],
                          "NumRadialDistortionCoefficients": 3,
                          "TangentialDistortion": [0.001, -0.001]}, LENS),
    "npz": ("a.npz", saved(mtx=np.array(K), dist=np.array([BROWN]), rvecs=np.ones((4, 3))), LENS),
    "npy": ("a.npy", array(np.array(K)), None),
    "text": ("cam_K.txt", "\n".join(" ".join(map(str, row)) for row in K), None),
    "text with a fourth row": ("K.txt", "500 0 321 0\n0 510 239 0\n0 0 1 0\n0 0 0 1\n", None),
}  # fmt: skip


def assert_reads(path: Path, content: Any, matrix: Any, lens: Lens | None) -> None:
    camera, _ = load_calibration(Calibration(write(path, content)), "p.png", 640, 480)
    np.testing.assert_allclose(opencv_matrix(camera.camera), matrix, rtol=0.0, atol=1e-9)
    assert camera.lens == lens
    assert camera.read


@pytest.mark.parametrize("form", FORMS)
def test_a_camera_is_the_same_in_each_form(tmp_path, form):
    name, content, lens = FORMS[form]
    assert_reads(tmp_path / name, content, K, lens)


RADIAL, NO_LENS = Lens("opencv", (0.02, -0.01, 0.0, 0.0, 0.0)), None
EQUIDISTANT = Lens("fisheye", (0.02, -0.01, 0.0, 0.0))
NGP: list[tuple[dict[str, Any], Lens | None]] = [
    *(({"is_fisheye": value}, EQUIDISTANT) for value in (True, 1, 1.0, "true", "1")),
    *(({"is_fisheye": value}, RADIAL) for value in (False, 0, None, "false")),
    *(({"camera_model": name}, RADIAL) for name in ("OPENCV", "RADIAL", "SIMPLE_RADIAL")),
    ({"camera_model": "OPENCV_FISHEYE"}, EQUIDISTANT),
    ({"camera_model": "OPENCV_FISHEYE", "is_fisheye": False}, EQUIDISTANT),
    ({"camera_model": "PINHOLE", "k1": 0, "k2": 0}, NO_LENS),
]


@pytest.mark.parametrize(("said", "lens"), NGP, ids=lambda value: str(value)[:40])
def test_a_fisheye_of_instant_ngp_and_nerfstudio_is_one(tmp_path, said, lens):
    own = {"fl_x": 500, "fl_y": 510, "cx": 321.5, "cy": 239.5, "k1": 0.02, "k2": -0.01, **said}
    assert_reads(tmp_path / "a.json", {**own, "w": 640, "h": 480}, K, lens)


SQUARE = [[500.0, 0.0, 329.5], [0.0, 500.0, 234.5], [0.0, 0.0, 1.0]]
"""Of a principal point 10 px right of the middle of 640x480 px, and 5 px above it."""
CENTRED = [[500.0, 0.0, 319.5 / 0.64], [0.0, 500.0, 239.5 / 0.64], [0.0, 0.0, 1.0]]
MESHROOM = {"intrinsicId": 7, "width": "640", "height": "480", "distortionParams": [".1", "2", "3"]}
FROM_THE_MIDDLE: dict[str, tuple[str, Any, Lens | None]] = {
    "metashape": ("a.xml", "<document><chunk><sensors><sensor id='0'><calibration class='initial'>"
                  "<resolution width='640' height='480'/><f>9</f><cx>0</cx><cy>0</cy></calibration>"
                  "<calibration class='adjusted'><resolution width='640' height='480'/><f>500</f>"
                  "<cx>10</cx><cy>-5</cy></calibration></sensor></sensors></chunk></document>",
                  None),
    "fspy": ("a.json", {"principalPoint": {"x": 10 / 320, "y": 5 / 320}, "imageWidth": 640,
                        "imageHeight": 480, "relativeFocalLength": 500 / 320}, None),
    "realitycapture": ("a.csv", "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\n"
                       f"p.png,1,2,3,4,5,6,{500 * 36 / 640},{10 * 36 / 640},{-5 * 36 / 640},"
                       "-0.3,0.1,0.02,0,0,0\nq.png,1,2,3,4,5,6,9,0,0,0,0,0,0,0,0\n",
                       Lens("opencv", (-0.3, 0.1, 0.0, 0.0, 0.02))),
    "opensfm": ("a.json", [{"cameras": {
        "b c": {"projection_type": "brown", "width": 640, "height": 480, "focal_x": 500 / 640,
                "focal_y": 500 / 640, "c_x": 10 / 640, "c_y": -5 / 640, **NAMED}},
        "shots": {"p.png": {"camera": "b c"}}}], LENS),
    "opensfm, fisheye": ("a.json", {"v2": {
        "projection_type": "fisheye", "width": 640, "height": 480, "focal": 0.5, "k1": 0.02,
        "k2": -0.01}}, Lens("fisheye", (0.02, -0.01, 0.0, 0.0))),
    "meshroom": ("a.sfm", {"version": ["1", "2", "6"], "intrinsics": [
        {**MESHROOM, "type": "pinhole", "distortionType": "radialk3", "sensorWidth": "36",
         "focalLength": str(500 * 36 / 640), "principalPoint": ["10", "-5"]}]},
        Lens("opencv", (0.1, 2.0, 0.0, 0.0, 3.0))),
    "meshroom of 2019": ("a.sfm", {"version": ["1", "0", "0"], "intrinsics": [
        {**MESHROOM, "type": "radial3", "pxFocalLength": "500", "principalPoint": ["330", "235"]}]},
        Lens("opencv", (0.1, 2.0, 0.0, 0.0, 3.0))),
}  # fmt: skip


@pytest.mark.parametrize("form", FROM_THE_MIDDLE)
def test_a_principal_point_may_count_from_the_middle(tmp_path, form):
    name, content, lens = FROM_THE_MIDDLE[form]
    matrix = np.diag([0.64, 0.64, 1.0]) @ CENTRED if "fisheye" in form else SQUARE
    assert_reads(tmp_path / name, content, matrix, lens)


@pytest.mark.parametrize(("said", "lens"), [
    ({}, None),
    ({"disto_k1": [0.02]}, Lens("opencv", (0.02, 0.0, 0.0, 0.0, 0.0))),
    ({"disto_k3": [-0.3, 0.1, 0.02]}, Lens("opencv", (-0.3, 0.1, 0.0, 0.0, 0.02))),
    ({"disto_t2": [-0.3, 0.1, 0.02, 0.001, -0.001]}, LENS),
    ({"fisheye": FISHEYE}, Lens("fisheye", FISHEYE)),
])  # fmt: skip
@pytest.mark.parametrize("is_based", [False, True])
def test_openmvgs_lenses_are_in_its_order(tmp_path, said, lens, is_based):
    """Some versions write the pinhole as ``value0`` beside the lens."""
    numbers = {**SIZE, "focal_length": 500.0, "principal_point": [321.0, 239.0]}
    wrapped = {"id": 7, "data": {**({"value0": numbers} if is_based else numbers), **said}}
    camera = {"key": 0, "value": {"polymorphic_name": "a", "ptr_wrapper": wrapped}}
    view = {"ptr_wrapper": {"data": {"filename": "p.png", **SIZE, "id_intrinsic": 0}}}
    data = {"views": [{"key": 0, "value": view}], "intrinsics": [camera]}
    matrix = [[500.0, 0.0, 321.0], [0.0, 500.0, 239.0], [0.0, 0.0, 1.0]]
    assert_reads(tmp_path / "sfm_data.json", data, matrix, lens)


def test_nerfs_angle_is_that_of_the_width(tmp_path):
    content = {"camera_angle_x": 2.0 * np.arctan(0.5 * 640 / 500.0), "frames": []}
    matrix = [[500.0, 0.0, 319.5], [0.0, 500.0, 239.5], [0.0, 0.0, 1.0]]
    assert_reads(tmp_path / "transforms.json", content, matrix, None)


def test_the_cameras_of_a_file_are_told_apart_by_names_numbers_and_sides(tmp_path):
    def names(content: Any) -> list[str]:
        return [camera.name for camera in load_cameras(write(tmp_path / "a.json", content))]

    assert names({"left": {"K": K, "D": BROWN}, "right": {"K": K}}) == ["left", "right"]
    assert names({"K1": K, "D1": BROWN, "K2": K, "P1": K}) == ["1", "2"]
    assert len(names({f"K_{number:03}": K for number in range(300)})) == 300
    assert names({"camera_matrix_left": K, "dist_left": BROWN, "cameraMatrixRight": K}) == [
        "left", "right"]  # fmt: skip
    assert names([{"id": "p", "camera": FOCALS}, {"id": "q", "camera": FOCALS}]) == ["p", "q"]
    assert names({"cameras": [{"name": "a", **FOCALS}, {"name": "b", **FOCALS}]}) == ["a", "b"]


def test_the_models_of_one_visp_camera_are_told_apart_by_their_types(tmp_path):
    numbers = "<px>500</px><py>510</py><u0>321</u0><v0>239</v0>"
    models = "".join(
        f"<model><type>{name}</type>{numbers}{lens}</model>"
        for name, lens in (
            ("perspectiveProjWithoutDistortion", ""),
            ("perspectiveProjWithDistortion", "<kud>-0.3</kud><kdu>0.33</kdu>"),
        )
    )
    path = write(tmp_path / "camera.xml", f"<root><camera>{models}</camera></root>")
    cameras = {camera.name: camera.lens for camera in load_cameras(path)}
    assert cameras == {
        "perspectiveProjWithoutDistortion": None,
        "perspectiveProjWithDistortion": Lens("opencv", (-0.3, 0.0, 0.0, 0.0, 0.0)),
    }
    fisheye = models.replace("perspectiveProjWithDistortion", "ProjWithKannalaBrandtDistortion")
    with pytest.raises(CalibrationFileError, match="ProjWithKannalaBrandtDistortion"):
        load_cameras(write(path, f"<root><camera>{fisheye}</camera></root>"))


def test_the_size_of_a_chessboard_is_not_that_of_pictures(tmp_path):
    path = write(tmp_path / "a.json", {"K": K, "w": 9, "h": 6, "size": [9, 6], "square_size": 25})
    assert load_cameras(path)[0].camera.width == 0


HALF = {"fx": 250, "fy": 255, "cx": 160.25, "cy": 119.25}
"""The camera in pictures of half the size."""
HALF_SIZES: dict[str, Any] = {
    "ndds": {"intrinsic_settings": HALF | {"resX": 320, "resY": 240, "s": 0}},
    "beside": {"camera_settings": [{"intrinsics": HALF,
                                    "captured_image_size": {"width": 320, "height": 240}}]},
    "dim": HALF | {"DIM": [320, 240]},
    "rows and columns": HALF | {"ImageSize": [240, 320]},
    "a shape": HALF | {"img_shape": [240, 320, 3]},
    "x and y": HALF | {"resolution": {"x": 320, "y": 240}},
    "of the photo": {"photo": {"file": "p.png", "width": 320, "height": 240}, "camera": HALF},
    "a text": HALF | {"resolution": "320x240"},
    "cols and rows": HALF | {"cols": 320, "rows": 240},
    "above": {"image_dims": [[320, 240]], "left": HALF},
    "a list beside": {"intrinsics": [HALF], "resolution": [[320, 240]]},
    "gyroflow": {"calib_dimension": {"w": 320, "h": 240}, "orig_dimension": {"w": 9000, "h": 80},
                 "fisheye_params": HALF, "distortion_model": "opencv_standard"},
}  # fmt: skip


@pytest.mark.parametrize("case", HALF_SIZES)
def test_a_camera_is_scaled_by_its_size_under_any_key(tmp_path, case):
    assert_reads(tmp_path / "a.json", HALF_SIZES[case], K, None)


def test_a_size_that_is_not_understood_is_refused(tmp_path):
    for more, words in (
        ({"rectified_dimensions_px": [320, 240]}, "'rectified_dimensions_px' may be the size"),
        ({"image_size": [320, 240], "original_size": [640, 480]}, "320x240 px .* and 640x480 px"),
    ):
        with pytest.raises(CalibrationFileError, match=words):
            load_cameras(write(tmp_path / "a.json", FOCALS | more))


LOST = {
    "a key of its own": ({"K": K, "lens_distortion_vector": BROWN}, "'lens_distortion_vector'"),
    "beside the camera": ({"color": FOCALS, "extra": {"dist_params": BROWN}}, "'dist_params'"),
    "a fourth radial term": ({"fl_x": 5, "cx": 1, "cy": 1, "w": 2, "h": 2, "k4": 0.1}, "'k4'"),
    "metashape's shear": ({**SIZE, "f": 500, "cx": 0, "cy": 0, "b2": 1}, "'b2'"),
    "realitycapture's t1": ({"f": 35, "px": 0, "py": 0, "t1": 0.1}, "'t1'"),
    "another model": ({"K": K, "D": FISHEYE, "distortion_model": "fov"}, "'fov'"),
    "a type of lens": ({"K": K, "D": FISHEYE, "lens_type": "Equisolid"}, "'Equisolid'"),
    "a lens of one number": ({**FOCALS, "w": 0.87}, "'w'"),
    "that of a type": ({"camera_type": "fov", "intrinsics": {**FOCALS, "w": 0.87}}, "'fov'"),
    "a fisheye of another number": ({"fisheye": {"K": K, "D": BROWN}}, "5 distortion"),
    "four numbers": ({"DIM": [640, 480], "K": K, "D": FISHEYE}, "of which lens model"),
    "four of a pinhole": ({"K": K, "D": FISHEYE, "model": "pinhole"}, "of which lens model"),
    "four names": ({**FOCALS, **FOUR}, "of which lens model"),
    "coefficients of another camera": ({"K": K, "D1": BROWN}, "'D1'"),
    "a name that says nothing": ({"K": K, "v": BROWN}, "'v'"),
    "the left lens of no left camera": ({"K": K, "D_left": BROWN[:4]}, "'D_left'"),
    "panorama tools": ({**FOCALS, "a": 0.01, "b": -0.03, "c": 0.02}, "'a'"),
    "a division": ({**FOCALS, "camera_type": "div", "lambda": -0.2}, "'div'"),
    "a division of no type": ({**FOCALS, "lambda": -0.2}, "'lambda'"),
    "one of two tangential": ({**FOCALS, "k1": -0.3, "k2": 0.1, "r1": 0.01}, "'r1'"),
    "a mapping within": ({**FOCALS, "lens_params": {"r2": -0.21, "r4": 0.05}}, "'lens_params'"),
    "another mapping within": ({"cam": {**FOCALS, "optics": {"q2": -0.21}}}, "'optics'"),
    "f-theta": ({"fl_x": 5, "cx": 1, "cy": 1, "ftheta_p1": 0.3}, "'ftheta_p1'"),
    "a panorama": ({"fl_x": 5, "cx": 1, "cy": 1, "equirectangular": True}, "'equirectangular'"),
    "thin prisms": ({"fl_x": 5, "cx": 1, "cy": 1, "s1": 0.3}, "'s1'"),
    "double sphere": ({"camera_type": "ds", "intrinsics": {**FOCALS, "xi": -0.2}}, "'ds'"),
    "double sphere of no type": ({**FOCALS, "xi": -0.2}, "'xi'"),
    "an inverse model": ({**FOCALS, "model": "inverse_brown_conrady", "coeffs": BROWN}, "inverse"),
    "omnidirectional": ({"camera_model": "omni", "intrinsics": [1, 5, 5, 2, 2]}, "intrinsics"),
    "meshroom's brown": ({**MESHROOM, "pxFocalLength": 5, "principalPoint": [0, 0], "version": [1],
                          "distortionParams": [1, 2, 3, 4, 5]}, "Brown"),
}  # fmt: skip


FISHEYES: dict[str, Any] = {
    "basalt": {"value0": {"intrinsics": [{"camera_type": "kb4", "intrinsics": FOCALS | FOUR}]}},
    "kb8": {"value0": {"intrinsics": [{"camera_type": "KB-8", "intrinsics": FOCALS | FOUR}]}},
    "gyroflow": {"fisheye_params": {"camera_matrix": K, "distortion_coeffs": FISHEYE}},
    "a key": {"K": K, "fisheye_coeffs": FISHEYE},
    "a type of lens": {"K": K, "D": FISHEYE, "lens_type": "Fisheye"},
    "a type above": {"model": "equidistant", "left": {"K": K, "D": FISHEYE}},
    "zeros behind": {"K": K, "D": [*FISHEYE, 0, 0], "camera_model": "fisheye"},
    "orb-slam": {"Camera.type": "KannalaBrandt8"}
    | {f"Camera.{key}": value for key, value in (FOCALS | FOUR).items()},
}


@pytest.mark.parametrize("case", FISHEYES)
def test_a_fisheye_is_known_by_its_names(tmp_path, case):
    (found,) = load_cameras(write(tmp_path / "a.json", FISHEYES[case]))
    assert found.lens == Lens("fisheye", FISHEYE)


def test_a_model_that_is_said_below_its_name_counts_more(tmp_path):
    mode = FISHEYES["gyroflow"] | {"lens_model": "Standard"}  # of GoPro's and DJI's
    assert load_cameras(write(tmp_path / "a.json", mode))[0].lens == Lens("fisheye", FISHEYE)
    standard = mode | {"distortion_model": "opencv_standard"}
    assert load_cameras(write(tmp_path / "a.json", standard))[0].lens == Lens("opencv", FISHEYE)
    for more in ({"distortion_model": "poly5"}, {"digital_lens": "gopro_superview"}):
        with pytest.raises(CalibrationFileError, match=r"its lens model is '(poly5|gopro_super)"):
            load_cameras(write(tmp_path / "a.json", mode | more))


@pytest.mark.parametrize("kind", ["rgb camera", "RGB\n", "ir", 30_000 * "rgb" + "\n"])
def test_the_kind_of_a_camera_is_no_lens_model_however_long(tmp_path: Path, kind: str) -> None:
    assert_reads(tmp_path / "a.json", {**FOCALS, "camera_type": kind}, K, None)


def test_the_rectified_camera_and_that_of_the_photo_are_two(tmp_path):
    camera = {f"Camera.{key}": value for key, value in FOCALS.items()}
    left = {"LEFT.K": {"data": FLAT}, "LEFT.D": {"data": BROWN}, "Camera.type": "PinHole"}
    found = load_cameras(write(tmp_path / "a.json", camera | left))
    assert [(one.name, one.lens) for one in found] == [("Camera", None), ("LEFT", LENS)]


@pytest.mark.parametrize("case", LOST)
def test_a_lens_is_never_dropped(tmp_path, case):
    content, words = LOST[case]
    with pytest.raises(CalibrationFileError, match=words):
        load_cameras(write(tmp_path / "a.json", content))


SENSOR = {"K": [[900, 0, 650], [0, 900, 470], [0, 0, 1]], "width": 1280, "height": 960}
WINDOW = {"x_offset": 320, "y_offset": 200, "height": 480, "width": 640, "do_rectify": True}
OF_SIZE = SENSOR | {"width": 640, "height": 480}
IN_WINDOW = {"K": [[900, 0, 330], [0, 900, 270], [0, 0, 1]], "width": 640, "height": 480}
WINDOWS = {
    "ros": {**SENSOR, "binning_x": 1, "roi": WINDOW},
    "offsets of a sensor": {**SENSOR, "offset_x": 320, "offset_y": 200},
    "offsets of a window": {**OF_SIZE, "offsetX": 320, "offsetY": 200},
    "a camera of its window": {**IN_WINDOW, "OffsetX": 320, "OffsetY": 200},
    "that with a size": {**IN_WINDOW, "roi": WINDOW},
    "a crop": {**SENSOR, "crop": {"left": 320, "top": 200, "width": 640, "height": 480}},
    "a crop in a list": {**SENSOR, "crop": [320, 200, 640, 480]},
    "a crop of two corners": {**SENSOR, "crop": [320, 200, 960, 680]},
}


@pytest.mark.parametrize("name", WINDOWS)
def test_the_window_of_a_sensor_is_subtracted_and_never_scaled(tmp_path, name):
    choice = Calibration(write(tmp_path / "a.json", WINDOWS[name]))
    found, notes = load_calibration(choice, "a.png", 640, 480)
    camera = found.camera
    assert (camera.fx, camera.cx, camera.cy) == (900.0, 330.5, 270.5)
    assert (camera.width, camera.height, notes) == (640, 480, ())


def test_a_window_of_the_sensor_may_be_binned_and_that_of_a_whole_photo_is_none(tmp_path):
    choice = Calibration(write(tmp_path / "a.json", {**SENSOR, "roi": WINDOW}))
    halved, _ = load_calibration(choice, "a.png", 320, 240)
    assert (halved.camera.fx, halved.camera.cx, halved.camera.cy) == (450.0, 165.25, 135.25)
    whole, _ = load_calibration(choice, "a.png", 1280, 960)
    assert (whole.camera.cx, whole.camera.cy) == (650.5, 470.5)
    corner = SENSOR | {"roi": WINDOW | {"x_offset": 0, "y_offset": 0, "width": 800, "height": 600}}
    found, notes = load_calibration(Calibration(write(tmp_path / "b.json", corner)), "", 1200, 900)
    assert (found.camera.fx, found.camera.width) == (1350.0, 1200)
    assert "far from the middle of the photo's 800x600 px" in notes[0]
    for none in ({**SENSOR, "roi": dict.fromkeys(WINDOW, 0)},
                 {**SENSOR, "roi": [5, 5, 1200, 900]}):  # fmt: skip
        found, _ = load_calibration(Calibration(write(tmp_path / "c.json", none)), "", 640, 480)
        assert found.camera.fx == 450.0


def test_a_principal_point_near_the_edge_is_said(tmp_path):
    near = {**FOCALS, **SIZE, "cx": 631}
    _, notes = load_calibration(Calibration(write(tmp_path / "a.json", near)), "", 640, 480)
    assert "its principal point, 631, 239, is far from the middle" in notes[0]


def test_numbers_that_are_none_of_a_lens_do_not_hinder(tmp_path):
    pose = {"R": np.eye(3).tolist(), "t": [0.1, 0.2, 0.3], "E": K, "P": [[0.5] * 4] * 3}
    more = {"reprojection_error": 0.21, "square_size": 0.025, "sharpness": 31.5, "fps": 29.97,
            "T_cam_imu": pose, "type": "rgb camera", "is_on": True, "seen": 12}  # fmt: skip
    (found,) = load_cameras(write(tmp_path / "a.json", {**FOCALS, **NAMED, **pose, **more}))
    assert found.lens == LENS


def test_a_lens_model_of_an_unknown_name_may_be_said(tmp_path):
    path = write(tmp_path / "a.json", {**FOCALS, **FOUR, "camera_type": "my fish"})
    with pytest.raises(CalibrationFileError, match=r"'my fish'.*Calibration\.lens_model"):
        load_cameras(path)
    assert load_cameras(path, "fisheye")[0].lens == Lens("fisheye", FISHEYE)
    division = write(tmp_path / "b.json", {**FOCALS, **FOUR, "camera_type": "division"})
    with pytest.raises(CalibrationFileError, match="standard or fisheye model"):
        load_cameras(division, "fisheye")


MATRICES = (
    "K", "camera_matrix", "CameraMatrix", "mtx", "intrinsic", "intrinsics", "intrinsic_matrix",
    "cam_K", "Camera Matrix", "camera-matrix", "A", "cameraMatrix0", "left_K", "K_left",
)  # fmt: skip
LENSES = (
    "D", "d", "dist", "distCoeffs", "dist_coef", "distortion params", "lens_distortion", "kappa",
    "radial_tangential", "undistort_coeffs", "distorsion", "disto", "distCoeffs0", "D_left",
    "coefficients", "lens", "v",
)  # fmt: skip


@pytest.mark.parametrize("is_nested", [False, True])
@pytest.mark.parametrize("key", MATRICES)
def test_by_whatever_names_a_camera_is_right_or_refused(key, is_nested):
    reading = InputFile(Path("a.json"), error_type=CalibrationFileError)
    right = 0
    for name in LENSES:
        camera = {"camera": {key: K}} if is_nested else {key: K}
        try:
            (found,) = cameras_in(reading, {**camera, name: list(BROWN)})
        except CalibrationFileError:
            continue
        assert found.lens == LENS, name
        right += 1
    assert right >= 5 or is_nested or key in ("A", "cameraMatrix0", "left_K", "K_left")


@pytest.mark.parametrize(("content", "words"), [
    *(({**FOCALS, "cx": cx, "cy": cy}, r"principal point.*outside")
      for cx, cy in ((-3.0, 239.0), (321.0, 481.0), (1000.0, 239.0))),
    ({"K": [[0.78, 0, 0.5], [0, 1.04, 0.5], [0, 0, 1]]}, r"focal length of 0\.78 px"),
])  # fmt: skip
def test_points_outside_the_photo_and_shares_of_it_are_refused(tmp_path, content, words):
    path = write(tmp_path / "a.json", content)
    with pytest.raises(CalibrationFileError, match=words):
        load_calibration(Calibration(path), "p.png", 640, 480)
