"""STEP by its extra: a box of 20 x 30 x 40 in the file's unit is one in metres here."""

from pathlib import Path

import numpy as np
import pytest

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.load import load_mesh
from tests.commands import run

HEAD = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');FILE_NAME('','',(''),(''),'','','');FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));
ENDSEC;
DATA;
#1=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT({unit},.METRE.));
#2=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));
#3=(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT());
#4=(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNIT_ASSIGNED_CONTEXT((#1,#2,#3))REPRESENTATION_CONTEXT('',''));
#5=APPLICATION_CONTEXT('');
#6=PRODUCT_CONTEXT('',#5,'');
#7=PRODUCT('box','box','',(#6));
#8=PRODUCT_DEFINITION_FORMATION('','',#7);
#9=PRODUCT_DEFINITION_CONTEXT('',#5,'');
#10=PRODUCT_DEFINITION('','',#8,#9);
#11=PRODUCT_DEFINITION_SHAPE('','',#10);
#12=SHAPE_DEFINITION_REPRESENTATION(#11,#13);
#13=FACETED_BREP_SHAPE_REPRESENTATION('',(#14),#4);
#14=FACETED_BREP('',#15);
#15=CLOSED_SHELL('',(#106,#116,#126,#136,#146,#156));
"""
CORNERS = [(x, y, z) for x in (0, 20) for y in (0, 30) for z in (0, 40)]
FACES = {(0, 1, 3, 2): (-1, 0, 0), (4, 6, 7, 5): (1, 0, 0), (0, 4, 5, 1): (0, -1, 0),
         (2, 3, 7, 6): (0, 1, 0), (0, 2, 6, 4): (0, 0, -1), (1, 5, 7, 3): (0, 0, 1)}  # fmt: skip
"""Corners, and normals outwards."""


def box(unit: str) -> str:
    """A box of flat faces (ISO 10303-21 and -214)."""
    text = HEAD.replace("{unit}", unit)
    for number, corner in enumerate(CORNERS, 20):
        text += f"#{number}=CARTESIAN_POINT('',({'.,'.join(map(str, corner))}.));\n"
    for at, (corners, (x, y, z)) in zip(range(100, 160, 10), FACES.items(), strict=True):
        text += f"#{at}=POLY_LOOP('',({','.join(f'#{20 + corner}' for corner in corners)}));\n"
        text += f"#{at + 1}=FACE_OUTER_BOUND('',#{at},.T.);\n"
        text += f"#{at + 2}=DIRECTION('',({x}.,{y}.,{z}.));\n"
        text += f"#{at + 3}=DIRECTION('',({y}.,{z}.,{x}.));\n"
        text += f"#{at + 4}=AXIS2_PLACEMENT_3D('',#{20 + corners[0]},#{at + 2},#{at + 3});\n"
        text += f"#{at + 5}=PLANE('',#{at + 4});\n"
        text += f"#{at + 6}=FACE_SURFACE('',(#{at + 1}),#{at + 5},.T.);\n"
    return text + "ENDSEC;\nEND-ISO-10303-21;\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("unit", "metres", "said"),
    [(".MILLI.", 0.001, "0.02 x 0.03 x 0.04"), ("$", 1.0, "20 x 30 x 40")],
)
def test_a_box_is_read_in_metres_whatever_its_unit(tmp_path: Path, capsys, unit, metres, said):
    pytest.importorskip("cascadio", reason="pip install 'poseviewer[step]'")
    path = tmp_path / "box.step"
    path.write_text(box(unit))
    mesh = load_mesh(path)
    np.testing.assert_allclose(mesh.bounds, np.outer((0.0, metres), (20, 30, 40)), rtol=1e-6)
    assert (len(mesh.faces), mesh.part_names, mesh.unit) == (12, ("box",), "m")
    assert run("info", path) == 0
    assert f"{said} in m" in capsys.readouterr().out


@pytest.mark.parametrize("text", ["ISO-10303-21;", "solid\n", box("$")[:900]])
def test_what_is_none_gives_a_sentence(tmp_path: Path, text: str):
    (tmp_path / "box.stp").write_text(text)
    with pytest.raises(MeshFileError, match=r"^box\.stp: (STEP files need cascadio; pip|.*again)"):
        load_mesh(tmp_path / "box.stp")
