"""Blender materials of the street and the car, all procedural (no picture files)."""

from __future__ import annotations

import bpy

Colour = tuple[float, float, float]


class Material:
    """A material being built: `bsdf` is its surface, `add` puts in a node."""

    def __init__(self, name: str, colour: Colour = (0.5, 0.5, 0.5), **inputs: float) -> None:
        self.data = bpy.data.materials.new(name)
        self.data.use_nodes = True
        self.tree = self.data.node_tree
        self.bsdf = self.tree.nodes["Principled BSDF"]
        self.set(self.bsdf, {"Base Color": (*colour, 1.0)})
        self.set(self.bsdf, {key.replace("_", " "): value for key, value in inputs.items()})

    @staticmethod
    def set(node: bpy.types.Node, values: dict) -> None:
        """Give values to a node's inputs."""
        for key, value in values.items():
            node.inputs[key].default_value = value

    def add(self, kind: str, links: dict | None = None, **inputs: object) -> bpy.types.Node:
        """New node with its inputs linked to sockets (`links`) or given values."""
        node = self.tree.nodes.new(f"ShaderNode{kind}")
        self.set(node, {key.replace("_", " "): value for key, value in inputs.items()})
        for key, socket in (links or {}).items():
            self.tree.links.new(socket, node.inputs[key])
        return node

    def link(self, socket: bpy.types.NodeSocket, name: str) -> None:
        """Link a socket to an input of the surface."""
        self.tree.links.new(socket, self.bsdf.inputs[name])

    def where(self, scale: Colour = (1, 1, 1), turn_x: float = 0.0) -> bpy.types.NodeSocket:
        """World coordinates in metres, turned about x and scaled."""
        at = self.add("NewGeometry").outputs["Position"]
        node = self.add("Mapping", {"Vector": at}, Scale=scale, Rotation=(turn_x, 0, 0))
        return node.outputs["Vector"]

    def noise(self, scale: float, detail: float = 4.0) -> bpy.types.NodeSocket:
        """Noise in 0..1 with features of about 1/scale metres."""
        node = self.add("TexNoise", {"Vector": self.where()}, Scale=scale, Detail=detail)
        return node.outputs["Fac"]

    def ramp(
        self, value: bpy.types.NodeSocket, *stops: tuple[float, Colour]
    ) -> bpy.types.NodeSocket:
        """Colour by value."""
        node = self.add("ValToRGB", {"Fac": value})
        elements = node.color_ramp.elements
        while len(elements) < len(stops):
            elements.new(0.5)
        for element, (place, colour) in zip(elements, stops, strict=True):
            element.position, element.color = place, (*colour, 1.0)
        return node.outputs["Color"]

    def mix(self, a: object, b: object, factor: object, blend: str = "MIX") -> bpy.types.NodeSocket:
        """Mix two colours (sockets or values)."""
        node = self.tree.nodes.new("ShaderNodeMix")
        node.data_type, node.blend_type = "RGBA", blend
        for index, value in ((0, factor), (6, a), (7, b)):
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, node.inputs[index])
            else:
                node.inputs[index].default_value = value if index == 0 else (*value, 1.0)
        return node.outputs[2]

    def bump(self, height: bpy.types.NodeSocket, strength: float, distance: float) -> None:
        """Roughen the surface by a height pattern."""
        node = self.add("Bump", {"Height": height}, Strength=strength, Distance=distance)
        self.link(node.outputs["Normal"], "Normal")


def asphalt() -> bpy.types.Material:
    """Worn road: stone speckle, large stains, thin cracks."""
    m = Material("asphalt", Roughness=0.85)
    speck = m.ramp(
        m.noise(170.0, 2.0),
        (0.32, (0.050, 0.050, 0.052)),
        (0.50, (0.125, 0.122, 0.117)),
        (0.70, (0.28, 0.272, 0.26)),
    )
    stains = m.ramp(m.noise(0.9, 7.0), (0.34, (0.62, 0.62, 0.63)), (0.66, (1.18, 1.16, 1.12)))
    colour = m.mix(speck, stains, 1.0, "MULTIPLY")
    bent = m.mix(
        m.where(),
        m.add("TexNoise", {"Vector": m.where()}, Scale=2.5).outputs["Color"],
        0.16,
        "LINEAR_LIGHT",
    )
    crack = m.add("TexVoronoi", {"Vector": bent}, Scale=0.42)
    crack.feature = "DISTANCE_TO_EDGE"
    line = m.ramp(crack.outputs["Distance"], (0.0, (0.25, 0.25, 0.25)), (0.008, (1, 1, 1)))
    m.link(m.mix(colour, line, 1.0, "MULTIPLY"), "Base Color")
    m.bump(m.noise(190.0, 3.0), 0.7, 0.004)
    return m.data


def bricks(
    name: str,
    one: Colour,
    two: Colour,
    mortar: Colour,
    size: tuple[float, float],
    gap: float = 0.010,
    upright: bool = True,
    depth: float = 0.006,
) -> bpy.types.Material:
    """Courses of bricks (upright: in the x-z plane) or slabs on the ground (x-y)."""
    m = Material(name, Roughness=0.9)
    at = m.where(turn_x=-1.5707963 if upright else 0.0)
    node = m.add(
        "TexBrick",
        {"Vector": at},
        Color1=(*one, 1),
        Color2=(*two, 1),
        Mortar=(*mortar, 1),
        Scale=1.0,
        Mortar_Size=gap / 2,
        Brick_Width=size[0],
        Row_Height=size[1],
        Bias=-0.1,
        Mortar_Smooth=0.25,
    )
    soot = m.ramp(m.noise(1.3, 8.0), (0.30, (0.68, 0.67, 0.66)), (0.70, (1.14, 1.12, 1.10)))
    grain = m.ramp(m.noise(55.0, 5.0), (0.25, (0.72, 0.72, 0.72)), (0.75, (1.22, 1.22, 1.22)))
    colour = m.mix(m.mix(node.outputs["Color"], soot, 1.0, "MULTIPLY"), grain, 1.0, "MULTIPLY")
    m.link(colour, "Base Color")
    flat = m.add("Math", {0: node.outputs["Fac"]})
    flat.operation = "MULTIPLY_ADD"
    flat.inputs[1].default_value = -1.0
    m.tree.links.new(m.noise(70.0), flat.inputs[2])
    m.bump(flat.outputs[0], 0.6, depth)
    return m.data


def mottled(
    name: str,
    dark: Colour,
    light: Colour,
    scale: float,
    roughness: float = 0.85,
    depth: float = 0.003,
) -> bpy.types.Material:
    """Uneven matter: plaster, concrete, wood, leaves."""
    m = Material(name, Roughness=roughness)
    broad = m.ramp(m.noise(scale, 8.0), (0.30, dark), (0.70, light))
    fine = m.ramp(m.noise(scale * 25, 3.0), (0.3, (0.82, 0.82, 0.82)), (0.7, (1.12, 1.12, 1.12)))
    m.link(m.mix(broad, fine, 1.0, "MULTIPLY"), "Base Color")
    m.bump(m.noise(scale * 30, 4.0), 0.5, depth)
    return m.data


def worn_paint() -> bpy.types.Material:
    """Road marking, scuffed through to the asphalt."""
    m = Material("marking", Roughness=0.7)
    wear = m.ramp(m.noise(26.0, 9.0), (0.43, (0.62, 0.61, 0.57)), (0.60, (0.16, 0.16, 0.155)))
    m.link(
        m.mix(
            wear,
            m.ramp(m.noise(170.0, 2.0), (0.3, (0.6, 0.6, 0.6)), (0.6, (1, 1, 1))),
            1.0,
            "MULTIPLY",
        ),
        "Base Color",
    )
    m.bump(m.noise(190.0, 3.0), 0.5, 0.003)
    return m.data


def plain(name: str, colour: Colour, **inputs: float) -> bpy.types.Material:
    """One colour."""
    return Material(name, colour, **inputs).data


def tinted_glass(name: str, colour: Colour, clear: float) -> bpy.types.Material:
    """Thin pane: lets `clear` of the light through, reflects by Fresnel."""
    m = Material(name, colour, Roughness=0.0)
    through = m.add("BsdfTransparent", Color=(clear * 0.93, clear, clear * 0.96, 1))
    shine = m.add("BsdfGlossy", Roughness=0.004, Color=(1, 1, 1, 1))
    fresnel = m.add("Fresnel", IOR=1.55)
    both = m.add("MixShader", {0: fresnel.outputs[0], 1: through.outputs[0], 2: shine.outputs[0]})
    m.tree.links.new(both.outputs[0], m.tree.nodes["Material Output"].inputs["Surface"])
    return m.data


def car_material(kind: str, colour: Colour) -> bpy.types.Material:
    """What a part of the car is made of; its colour is the model file's."""
    if kind == "glass":
        return tinted_glass(kind, colour, 0.42)
    settings: dict[str, dict[str, float]] = {
        "paint": {"Roughness": 0.38, "Metallic": 0.12, "Coat_Weight": 1.0, "Coat_Roughness": 0.02},
        "trim": {"Roughness": 0.32},
        "plastic": {"Roughness": 0.62},
        "grille": {"Roughness": 0.5},
        "mirror": {"Roughness": 0.02, "Metallic": 1.0},
        "chrome": {"Roughness": 0.12, "Metallic": 1.0},
        "lamp clear": {"Roughness": 0.22, "Metallic": 0.55, "Coat_Weight": 1.0},
        "lamp bright": {"Roughness": 0.25, "Coat_Weight": 1.0, "Emission_Strength": 0.6},
        "lamp red": {"Roughness": 0.25, "Coat_Weight": 1.0},
        "lamp red bright": {"Roughness": 0.25, "Coat_Weight": 1.0, "Emission_Strength": 0.5},
        "plate": {"Roughness": 0.45},
        "rubber": {"Roughness": 0.8},
        "rim": {"Roughness": 0.28, "Metallic": 0.85},
        "dark metal": {"Roughness": 0.5, "Metallic": 0.6},
    }
    m = Material(kind, colour, **settings[kind])
    if "Emission_Strength" in settings[kind]:
        m.set(m.bsdf, {"Emission Color": (*colour, 1.0)})
    if kind == "paint":  # the skin has no thickness: its inside is the cabin's dark lining
        lining = m.add("BsdfDiffuse", Color=(0.05, 0.05, 0.052, 1))
        back = m.add("NewGeometry").outputs["Backfacing"]
        pick = m.add("MixShader", {0: back, 1: m.bsdf.outputs[0], 2: lining.outputs[0]})
        m.tree.links.new(pick.outputs[0], m.tree.nodes["Material Output"].inputs["Surface"])
    return m.data
