"""Blender materials for the finishes of a vehicle; their colours are the corners' own."""

from __future__ import annotations

from typing import Any

import bpy  # pyright: ignore[reportMissingImports]

COLOURS = "colours"
"""Name of the mesh's colour attribute."""
LINING = (0.05, 0.05, 0.052, 1.0)
"""Of the inside of the paint, which has no thickness: the cabin's dark lining."""
PANE_CLEAR, PANE_IOR = 0.4, 1.55
"""Share of the light that a tinted pane lets through; its refractive index, for reflections."""
SETTINGS: dict[str, dict[str, float]] = {
    "paint": {"Roughness": 0.36, "Metallic": 0.12, "Coat Weight": 1.0, "Coat Roughness": 0.02},
    "plastic": {"Roughness": 0.4},
    "rubber": {"Roughness": 0.8},
    "metal": {"Roughness": 0.22, "Metallic": 0.85},
    "glass": {},
}
"""Inputs of Blender's Principled BSDF for each finish."""


def make_material(finish: str) -> Any:
    """The material of a finish."""
    material = bpy.data.materials.new(finish)
    material.use_nodes = True
    tree = material.node_tree
    if finish == "glass":
        _make_pane(tree)
        return material
    surface = tree.nodes["Principled BSDF"]
    for name, value in SETTINGS[finish].items():
        surface.inputs[name].default_value = value
    colour = tree.nodes.new("ShaderNodeVertexColor")
    colour.layer_name = COLOURS
    tree.links.new(colour.outputs["Color"], surface.inputs["Base Color"])
    if finish == "paint":
        lining = tree.nodes.new("ShaderNodeBsdfDiffuse")
        lining.inputs["Color"].default_value = LINING
        back = tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"]
        _show(tree, _mixed(tree, back, surface, lining))
    return material


def _make_pane(tree: Any) -> None:
    """A thin pane: partly clear, and a mirror as far as Fresnel's equations have it."""
    through = tree.nodes.new("ShaderNodeBsdfTransparent")
    through.inputs["Color"].default_value = (PANE_CLEAR * 0.93, PANE_CLEAR, PANE_CLEAR * 0.96, 1.0)
    shine = tree.nodes.new("ShaderNodeBsdfGlossy")
    shine.inputs["Roughness"].default_value = 0.004
    fresnel = tree.nodes.new("ShaderNodeFresnel")
    fresnel.inputs["IOR"].default_value = PANE_IOR
    _show(tree, _mixed(tree, fresnel.outputs[0], through, shine))


def _mixed(tree: Any, share: Any, first: Any, second: Any) -> Any:
    mix = tree.nodes.new("ShaderNodeMixShader")
    tree.links.new(share, mix.inputs[0])
    tree.links.new(first.outputs[0], mix.inputs[1])
    tree.links.new(second.outputs[0], mix.inputs[2])
    return mix


def _show(tree: Any, shader: Any) -> None:
    tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
