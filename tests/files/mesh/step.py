"""A box as a STEP file (ISO 10303-214), written by hand."""

from itertools import product

HEAD = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('','',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));
ENDSEC;
DATA;
"""
SIDES = {
    (0, 0, -1): "000 010 110 100", (0, 0, 1): "001 101 111 011", (0, -1, 0): "000 100 101 001",
    (0, 1, 0): "010 011 111 110", (-1, 0, 0): "000 001 011 010", (1, 0, 0): "100 110 111 101",
}  # fmt: skip
"""Outward normals, and the corners counter-clockwise."""


def box_in_step(x: float, y: float, z: float) -> str:
    """The file of a box from the origin, in mm."""
    lines: list[str] = []

    def add(text: str) -> str:
        lines.append(f"#{len(lines) + 1}={text};\n")
        return f"#{len(lines)}"

    points, vertices, edges, faces = {}, {}, {}, []
    for i, j, k in product((0, 1), repeat=3):
        corner = f"{i}{j}{k}"
        points[corner] = add(f"CARTESIAN_POINT('',({i * x:.6f},{j * y:.6f},{k * z:.6f}))")
        vertices[corner] = add(f"VERTEX_POINT('',{points[corner]})")

    def direction(*along: int) -> str:
        return add(f"DIRECTION('',({along[0]}.,{along[1]}.,{along[2]}.))")

    for normal, text in SIDES.items():
        corners, loop = text.split(), []
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            if (b, a) not in edges:
                along = direction(*(int(q) - int(p) for p, q in zip(a, b, strict=True)))
                vector = add(f"VECTOR('',{along},1.)")
                line = add(f"LINE('',{points[a]},{vector})")
                edges[a, b] = add(f"EDGE_CURVE('',{vertices[a]},{vertices[b]},{line},.T.)")
            edge, turned = edges.get((a, b), edges.get((b, a))), ".T." if (a, b) in edges else ".F."
            loop.append(add(f"ORIENTED_EDGE('',*,*,{edge},{turned})"))
        bound = add(f"EDGE_LOOP('',({','.join(loop)}))")
        bound = add(f"FACE_OUTER_BOUND('',{bound},.T.)")
        first, second = direction(*normal), direction(normal[1], normal[2], normal[0])
        place = add(f"AXIS2_PLACEMENT_3D('',{points[corners[0]]},{first},{second})")
        plane = add(f"PLANE('',{place})")
        faces.append(add(f"ADVANCED_FACE('',({bound}),{plane},.T.)"))
    shell = add(f"CLOSED_SHELL('',({','.join(faces)}))")
    solid = add(f"MANIFOLD_SOLID_BREP('',{shell})")
    length = add("(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.))")
    angle = add("(NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.))")
    units = add(
        f"(GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle})) "
        "REPRESENTATION_CONTEXT('',''))"
    )
    axes = direction(0, 0, 1), direction(1, 0, 0)
    origin = add(f"AXIS2_PLACEMENT_3D('',{points['000']},{axes[0]},{axes[1]})")
    shape = add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('',({origin},{solid}),{units})")
    context = add("APPLICATION_CONTEXT('automotive design')")
    product_context = add(f"PRODUCT_CONTEXT('',{context},'mechanical')")
    formation = add(f"PRODUCT('box','box','',({product_context}))")
    formation = add(f"PRODUCT_DEFINITION_FORMATION('','',{formation})")
    definition = add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{context},'design')")
    definition = add(f"PRODUCT_DEFINITION('design','',{formation},{definition})")
    definition = add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
    add(f"SHAPE_DEFINITION_REPRESENTATION({definition},{shape})")
    return f"{HEAD}{''.join(lines)}ENDSEC;\nEND-ISO-10303-21;\n"
