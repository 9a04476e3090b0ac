"""The drawn picture by pyrender: the projector as a spot light with a shadow, the fisheye in the vertex shader."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float

from sensor_model.geometry import inverse
from sensor_model.glass import check_inside
from sensor_model.optics import Optics, light
from sensor_model.rig import Rig
from sensor_model.ring_renderer import NO_SHADOW, gl_classes, prepare_gl
from sensor_model.shader_inputs import effects_of, print_table, reachable_mm, shadow_crop, slide_table, uniforms_of
from sensor_model.water import check_dry
from twin.bends import bent, bent_normals
from twin.mesh import Surface, bore_surface, feature_box, feature_surface
from twin.pipe import Pipe

CHUNK_MM = 100.0
SHARPEST_OD = 10.0  # a sharper bend's bore shades itself, which is not drawn


def draw(pipe: Pipe, T_pipe_camera: Float[np.ndarray, "4 4"], rig: Rig, optics: Optics) -> Float[np.ndarray, "h w 3"]:
    """The direct picture in linear light, float32 RGB; 1 is a white wall at the reference distance, lit head-on.

    The same signature and meaning as `raycast.draw`, which it is checked against. The first call in a process opens
    its one renderer, which lives as long as the process.

    Args:
        pipe: What is looked at.
        T_pipe_camera: Camera pose, mm.
        rig: The true camera and projector.
        optics: The settings that act on the wall; those of lens and chip are left to `expose`.

    Raises:
        ValueError: when the camera or the projector's apex lies outside the bore, or in the water, or a bend is too
            sharp to draw.
        RuntimeError: when no GL can be had.
    """
    check_inside(pipe, T_pipe_camera, rig, optics.glass)
    check_dry(pipe, T_pipe_camera, rig, optics.water, optics.glass)
    sharpest = min((bend.radius_od for bend in pipe.bends), default=np.inf)
    if sharpest < SHARPEST_OD:
        raise ValueError(
            f"a bend of {sharpest:g} outer diameters shades itself, which is not drawn below {SHARPEST_OD:g}; "
            "sensing.fidelity: raycast and points can"
        )
    return _studio().draw(pipe, T_pipe_camera, rig, optics)


@cache
def _studio() -> _Studio:
    return _Studio()


class _Studio:
    """One renderer and the scene around the camera: chunks of bore and patches of features that light can reach."""

    def __init__(self) -> None:
        gl, pyrender = gl_classes(), prepare_gl()
        self.pyrender, self.screen = pyrender, gl.RingScreen()
        self.scene = pyrender.Scene(bg_color=np.zeros(4), ambient_light=np.zeros(3))
        self.camera = self.scene.add(pyrender.IntrinsicsCamera(1, 1, 0, 0))  # the shaders have their own lens
        self.projector = self.scene.add(gl.RingProjector())
        self.material = pyrender.MetallicRoughnessMaterial(doubleSided=True)
        self.pipe: Pipe | None = None
        self.drawn: dict[tuple[str, int], tuple[Any, float]] = {}

    def draw(self, pipe: Pipe, T_pipe_camera: np.ndarray, rig: Rig, optics: Optics) -> np.ndarray:
        T_world_pipe = np.eye(4)
        T_world_pipe[2, 3] = -T_pipe_camera[2, 3]
        T_world_camera = T_world_pipe @ T_pipe_camera
        T_world_projector = T_world_camera @ rig.projector.T_camera_projector
        features = self._furnish(pipe, *reachable_mm(pipe, T_pipe_camera, rig, optics), T_pipe_camera[2, 3])
        beam = light(rig.projector, optics)
        slide, slide_range = slide_table(beam)
        T_projector_pipe = inverse(T_world_projector) @ T_world_pipe
        crop = shadow_crop(pipe, features, T_pipe_camera[2, 3], T_projector_pipe, beam.lit_to[-1], optics)
        self.scene.set_pose(self.camera, T_world_camera)
        self.scene.set_pose(self.projector, T_world_projector)
        self.projector.light.crop = crop or NO_SHADOW
        shaded = {n.mesh.primitives[0] for (kind, _), (n, _) in self.drawn.items() if kind == "feature"}
        uniforms = uniforms_of(pipe, T_pipe_camera, rig, optics, beam, crop or NO_SHADOW)
        uniforms["slide_range"] = slide_range
        effects = effects_of(rig, beam, crop, optics)
        size = (rig.camera.width_px, rig.camera.height_px)
        tables = {"slide": slide, "print": print_table(rig.projector)}

        def seen(*way: str) -> np.ndarray:
            return self.screen.picture(self.scene, size, tables, uniforms, effects | {*way}, shaded)

        if "WATER" not in effects:
            return seen()
        dry, pool = seen(), seen("MIRRORED") + seen("UNDER")
        return dry[..., :3] + (1 - dry[..., 3:]) * pool[..., :3]

    def _furnish(self, pipe: Pipe, z_from: float, z_to: float, camera_z: float) -> list[int]:
        """Keep what is in reach in the scene, and nothing else; returns the features there."""
        if pipe is not self.pipe and pipe != self.pipe:
            self._clear(set())
        self.pipe = pipe
        wanted = _wanted(pipe, z_from, z_to)
        self._clear(wanted)
        for key in wanted - self.drawn.keys():
            self.drawn[key] = self._hang(_build(pipe, key))
        T_camera_world = inverse(pipe.axis.frame(camera_z))
        for node, z_mm in self.drawn.values():
            pose = np.eye(4)
            pose[2, 3] = z_mm - camera_z
            self.scene.set_pose(node, T_camera_world @ pipe.axis.frame(z_mm) if pipe.bends else pose)
        return [index for kind, index in wanted if kind == "feature"]

    def _clear(self, wanted: set[tuple[str, int]]) -> None:
        for key in self.drawn.keys() - wanted:
            self.scene.remove_node(self.drawn.pop(key)[0])

    def _hang(self, piece: Surface) -> tuple[Any, float]:
        """A node with its vertices about its own distance: single precision then does for any pipe."""
        z_mm = float(piece.positions[:, 2].mean()) if piece.positions.size else 0.0
        positions, normals = piece.positions, piece.normals
        if self.pipe is not None and self.pipe.bends:
            normals = bent_normals(self.pipe.axis, z_mm, positions, normals)
            positions = bent(self.pipe.axis, z_mm, positions)
        primitive = self.pyrender.Primitive(
            positions=positions - [0, 0, z_mm],
            normals=normals,
            indices=piece.faces,
            material=self.material,
        )
        return self.scene.add(self.pyrender.Mesh([primitive])), z_mm


def _wanted(pipe: Pipe, z_from: float, z_to: float) -> set[tuple[str, int]]:
    """Names of the chunks of bore and of the features between two distances."""
    first = max(int((z_from - pipe.start_mm) // CHUNK_MM), 0)
    last = min(int((z_to - pipe.start_mm) // CHUNK_MM), int(np.ceil(pipe.length_mm / CHUNK_MM)) - 1)
    boxes = [(index, feature_box(pipe, index)) for index in range(len(pipe.wall.codes))]
    features = {("feature", index) for index, box in boxes if box.z_from_mm <= z_to and box.z_to_mm >= z_from}
    return {("bore", chunk) for chunk in range(first, last + 1)} | features


def _build(pipe: Pipe, key: tuple[str, int]) -> Surface:
    kind, index = key
    if kind == "feature":
        return feature_surface(pipe, index)
    start = pipe.start_mm + index * CHUNK_MM
    return bore_surface(pipe, start, min(start + CHUNK_MM, pipe.end_mm))
