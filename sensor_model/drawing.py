"""The drawn picture by pyrender: the projector as a spot light with a shadow, the fisheye in the vertex shader."""

from __future__ import annotations

import os
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from sensor_model.geometry import inverse, transform
from sensor_model.glass import Glass, check_inside, tube_of
from sensor_model.optics import REFERENCE_RANGE_MM, Light, Optics, light
from sensor_model.rig import Camera, Rig
from sensor_model.wall_rays import near_wall, wall_ranges_mm
from twin.bends import bent, bent_normals, unbent
from twin.mesh import Surface, bore_surface, feature_box, feature_surface
from twin.pipe import Pipe

SHADERS = Path(__file__).parent / "shaders"
SLIDE_TEXELS = 8192  # ten to a pixel of the picture
CHUNK_MM = 100.0
SHADOW_TEXELS = 2048
SHADOW_BIAS_MM = 0.25
SHADED_BEYOND_MM = 0.02  # the bore, being convex, shades nothing
NEAREST_MM = 1.0
HOLE_MM = 0.05
SHARPEST_OD = 10.0  # a sharper bend's bore shades itself, which is not drawn
BENT_MARGIN_MM = 25.0
BENDS_PER_MM, GLASS_REACH = 0.03, 3.0  # of glass: how far light is moved in tangent, at most, and in mm along the pipe


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
        ValueError: when the camera or the projector's apex lies outside the bore, or a bend is too sharp to draw.
        RuntimeError: when no GL can be had.
    """
    check_inside(pipe, T_pipe_camera, rig, optics.glass)
    sharpest = min((bend.radius_od for bend in pipe.bends), default=np.inf)
    if sharpest < SHARPEST_OD:
        raise ValueError(
            f"a bend of {sharpest:g} outer diameters shades itself, which is not drawn below {SHARPEST_OD:g}; "
            "sensing.fidelity: raycast and points can"
        )
    return _studio().draw(pipe, T_pipe_camera, rig, optics)


@cache
def _studio() -> Any:
    _prepare_gl()
    return _studio_class()()


def _prepare_gl() -> Any:
    """Import pyrender for a machine without a display, one core to a process."""
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    os.environ.setdefault("PYGLET_HEADLESS", "1")
    os.environ.setdefault("LP_NUM_THREADS", "0")  # llvmpipe rasterises in the calling thread
    if not hasattr(np, "infty"):
        np.infty = np.inf  # type: ignore[attr-defined]  # noqa: NPY201  pyrender's name for it, gone from numpy 2
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of pyrender's and PyOpenGL's own imports
        warnings.simplefilter("ignore", UserWarning)
        import pyrender
    return pyrender


def reachable_mm(pipe: Pipe, T_pipe_camera: np.ndarray, rig: Rig, glass: Glass) -> tuple[float, float]:
    """Distances along the pipe between which the projector's light can meet the wall or what shades it."""
    T_pipe_projector = T_pipe_camera @ rig.projector.T_camera_projector
    if pipe.bends:
        return _bent_reach_mm(pipe, T_pipe_camera, T_pipe_projector, rig)
    apex, axis = T_pipe_projector[:3, 3], T_pipe_projector[:3, 2]
    tilt = np.arccos(np.clip(axis[2], -1, 1))
    inner, outer = np.radians([rig.projector.inner_half_angle_deg, rig.projector.outer_half_angle_deg])
    farthest = (pipe.outer_radius_mm + np.hypot(*apex[:2])) / np.tan(max(inner - tilt, 0.05))
    nearest = (pipe.wall.smallest_radius - np.hypot(*apex[:2])) / np.tan(min(outer + tilt, 1.5))
    if glass.thickness_mm > 0:  # which sends some of it across the tube first
        farthest += 2 * (glass.inner_radius_mm + np.hypot(*glass.offset_mm)) / np.tan(max(inner - tilt, 0.05))
        nearest -= GLASS_REACH * glass.thickness_mm
    return float(apex[2] + nearest - 5.0), float(apex[2] + farthest + 5.0)


def _bent_reach_mm(
    pipe: Pipe, T_pipe_camera: np.ndarray, T_pipe_projector: np.ndarray, rig: Rig
) -> tuple[float, float]:
    """`reachable_mm` by following the light's outermost rays."""
    half = np.radians([rig.projector.inner_half_angle_deg, rig.projector.outer_half_angle_deg])
    alpha, turn = (a.ravel() for a in np.meshgrid(half, np.arange(72) * np.pi / 36))
    rays = np.stack([np.sin(alpha) * np.sin(turn), -np.sin(alpha) * np.cos(turn), np.cos(alpha)], axis=-1)
    rays = rays @ T_pipe_projector[:3, :3].T
    wall, apex = near_wall(pipe, float(T_pipe_camera[2, 3])), T_pipe_projector[:3, 3]
    ends = apex + wall_ranges_mm(wall, tuple(apex.tolist()), rays)[:, None] * rays
    z = [unbent(wall.axis, *end)[2] for end in ends.tolist()]
    return min(z) - BENT_MARGIN_MM, max(z) + BENT_MARGIN_MM


def shadow_crop(
    pipe: Pipe,
    features: list[int],
    about_mm: float,
    T_projector_pipe: np.ndarray,
    outer_tangent: float,
    margin: float = 0.0,
) -> tuple[float, float, float, float, float] | None:
    """Square of the projector's tangent plane that holds features: centre x, y, half side; then their depth range.

    None where nothing can be shaded. `margin` is added to the half side.
    """
    corners = []
    for index in features:
        box = feature_box(pipe, index)
        theta = np.linspace(
            box.theta_from_rad, box.theta_to_rad, 2 + int((box.theta_to_rad - box.theta_from_rad) / 0.05)
        )
        z = np.linspace(box.z_from_mm, box.z_to_mm, 2 + int((box.z_to_mm - box.z_from_mm) / 10))
        for rho in (pipe.wall.smallest_radius, pipe.outer_radius_mm * 1.01):
            t, at = (a.ravel() for a in np.meshgrid(theta, z))
            corners.append(np.stack([rho * np.sin(t), -rho * np.cos(t), at, np.ones_like(at)], axis=-1))
    if not corners:
        return None
    places = np.concatenate(corners)
    if pipe.bends:
        places[:, :3] = bent(pipe.axis, about_mm, places[:, :3])
    place = places @ T_projector_pipe.T
    place = place[place[:, 2] > NEAREST_MM]
    tangents = place[:, :2] / place[:, 2:3]
    seen = np.linalg.norm(tangents, axis=1) <= 1.1 * outer_tangent
    if not seen.any():
        return None
    reach = 1.02 * outer_tangent
    low = np.maximum(tangents[seen].min(axis=0), -reach)
    high = np.minimum(tangents[seen].max(axis=0), reach)
    half = float(max(high - low) / 2) * 1.05 + margin
    middle = (low + high) / 2
    return (
        float(middle[0]),
        float(middle[1]),
        half,
        max(float(place[:, 2].min()) - 5, NEAREST_MM),
        float(place[:, 2].max()) + 5,
    )


def slide_table(beam: Light) -> tuple[Float[np.ndarray, "texels 4"], Float[np.ndarray, " 4"]]:
    """The slide as a table over the tangent of the half angle, and where that table and its light begin and end.

    A row has the light of all bands summed up to its tangent, so that the light between any two tangents is a
    difference, and the number of the nearest edge.
    """
    first, last = beam.lit_from[0] * 0.98, beam.lit_to[-1] * 1.02
    tangent = np.linspace(first, last, SLIDE_TEXELS)
    lit = np.array([beam.lit_from, beam.lit_to])
    passed = np.clip(tangent[:, None], *lit) - lit[0]
    edges = lit.T.ravel()
    nearest = np.abs(tangent[:, None] - edges).argmin(axis=1)
    table = np.concatenate([passed @ np.array(beam.colors), nearest[:, None]], axis=1).astype(np.float32)
    return table, np.array([first, tangent[1] - first, first, last])


@cache
def _studio_class() -> Any:
    """The classes over pyrender's, made when it is first imported."""
    pyrender = _prepare_gl()
    from OpenGL import GL
    from pyrender.camera import Camera as GlCamera
    from pyrender.constants import ProgramFlags, RenderFlags
    from pyrender.light import SpotLight
    from pyrender.offscreen import OffscreenRenderer
    from pyrender.renderer import Renderer
    from pyrender.shader_program import ShaderProgramCache
    from pyrender.texture import Texture

    class ShadowCamera(GlCamera):
        """Perspective over a square of the projector's tangent plane, in the projector's axes (z forward)."""

        def __init__(self, crop: tuple[float, ...]) -> None:
            super().__init__(znear=crop[3], zfar=crop[4])
            self.crop = crop

        def get_projection_matrix(self, width: Any = None, height: Any = None) -> np.ndarray:  # noqa: ARG002
            x, y, half, near, far = self.crop
            P = np.zeros((4, 4))
            P[0, 0], P[0, 2] = 1 / half, -x / half
            P[1, 1], P[1, 2] = 1 / half, -y / half
            P[2, 2], P[2, 3] = (far + near) / (far - near), -2 * far * near / (far - near)
            P[3, 2] = 1.0
            return P

    class RingProjector(SpotLight):
        """The projector: a spot light whose node has its axes, with a shadow map cropped to what can be shaded."""

        crop: tuple[float, ...] = (0.0, 0.0, 1.0, 1.0, 2.0)
        slide: int | None = None

        def show(self, slide: np.ndarray) -> None:
            """Put a slide in, (texels, 4) float32."""
            self.slide = GL.glGenTextures(1) if self.slide is None else self.slide
            GL.glBindTexture(GL.GL_TEXTURE_2D, self.slide)
            GL.glTexImage2D(GL.GL_TEXTURE_2D, 0, GL.GL_RGBA32F, len(slide), 1, 0, GL.GL_RGBA, GL.GL_FLOAT, slide)
            for side in (GL.GL_TEXTURE_MIN_FILTER, GL.GL_TEXTURE_MAG_FILTER):
                GL.glTexParameteri(GL.GL_TEXTURE_2D, side, GL.GL_NEAREST)

        def _bind(self) -> None:
            GL.glBindTexture(GL.GL_TEXTURE_2D, self.slide)

        def _generate_shadow_texture(self, size: Any = None) -> None:  # noqa: ARG002
            self.shadow_texture = Texture(
                width=SHADOW_TEXELS, height=SHADOW_TEXELS, source_channels="D", data_format=GL.GL_FLOAT
            )

        def _get_shadow_camera(self, scene_scale: float) -> Any:  # noqa: ARG002
            return ShadowCamera(self.crop)

    class RingRenderer(Renderer):
        """pyrender's passes with the shaders, the uniforms and the float buffer of this picture."""

        _main_fb: Any
        _main_fb_dims: Any

        def __init__(self, width: int, height: int) -> None:
            super().__init__(width, height)
            self._program_cache = ShaderProgramCache(shader_dir=str(SHADERS))
            self.uniforms: dict[str, Any] = {}
            self.effects: set[str] = set()
            self.shaded: set[Any] = set()  # primitives: features shade only themselves
            self._bound: set[int] = set()

        def __del__(self) -> None:
            """It lives as long as the process; at its end GL may be gone, and the system frees what it held."""

        def render(self, scene: Any, flags: int, seg_node_map: Any = None) -> np.ndarray:
            self._bound.clear()
            return super().render(scene, flags, seg_node_map)

        def _get_primitive_program(self, primitive: Any, flags: int, program_flags: int) -> Any:  # noqa: ARG002
            defines = {"NORMAL_LOC": 1, "INST_M_LOC": 2}
            if program_flags & ProgramFlags.USE_MATERIAL:
                fragments = "mesh.frag"
                defines |= {effect: 1 for effect in self.effects if effect != "SHADOWED" or primitive in self.shaded}
            else:
                fragments = "mesh_depth.frag"
                defines |= {"DEPTH": 1, **({"GLASS": 1} if "GLASS" in self.effects else {})}
            program = self._program_cache.get_program("mesh.vert", fragments, defines=defines)
            if not program._in_context():
                program._add_to_context()
            if "DEPTH" in defines and "GLASS" in defines:  # no lights are bound in that pass
                program._bind()
                for name in ("tube", "tube_projector"):
                    program.set_uniform(name, self.uniforms[name])
            return program

        def _bind_lighting(self, scene: Any, program: Any, node: Any, flags: int) -> None:  # noqa: ARG002
            (projector,) = scene.spot_light_nodes
            if flags & RenderFlags.SHADOWS_SPOT:
                self._bind_texture(projector.light.shadow_texture, "shadow_map", program)
            self._bind_texture(projector.light, "slide", program)
            if program._program_id in self._bound:
                return  # uniforms stay with the program; only textures are bound mesh by mesh
            self._bound.add(program._program_id)
            for name, value in self.uniforms.items():
                program.set_uniform(name, value)

        def _shadow_mapping_pass(self, scene: Any, light_node: Any, flags: int) -> None:
            hidden = [m for m in scene.meshes if not self.shaded & set(m.primitives)]
            for mesh in hidden:
                mesh.is_visible = False
            super()._shadow_mapping_pass(scene, light_node, flags)
            for mesh in hidden:
                mesh.is_visible = True

        def _configure_shadow_mapping_viewport(self, light: Any, flags: int) -> None:
            super()._configure_shadow_mapping_viewport(light, flags)
            GL.glViewport(0, 0, SHADOW_TEXELS, SHADOW_TEXELS)

        def _configure_main_framebuffer(self) -> None:
            size = (self.viewport_width, self.viewport_height)
            if self._main_fb is not None and size != self._main_fb_dims:
                self._delete_main_framebuffer()
            if self._main_fb is None:
                self._main_cb, self._main_db = GL.glGenRenderbuffers(2)
                self._main_fb = self._main_fb_ms = GL.glGenFramebuffers(1)
                GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._main_fb)
                for buffer, kind, attachment in (
                    (self._main_cb, GL.GL_RGBA32F, GL.GL_COLOR_ATTACHMENT0),
                    (self._main_db, GL.GL_DEPTH_COMPONENT32F, GL.GL_DEPTH_ATTACHMENT),
                ):
                    GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
                    GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, kind, *size)
                    GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, attachment, GL.GL_RENDERBUFFER, buffer)
                self._main_fb_dims = size

        def _delete_main_framebuffer(self) -> None:
            if self._main_fb is not None:
                GL.glDeleteFramebuffers(1, [self._main_fb])
                GL.glDeleteRenderbuffers(2, [self._main_cb, self._main_db])
            self._main_fb = self._main_fb_ms = None

        def _read_main_framebuffer(self, scene: Any, flags: int) -> np.ndarray:  # noqa: ARG002
            GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._main_fb)
            GL.glReadBuffer(GL.GL_COLOR_ATTACHMENT0)
            GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
            width, height = self._main_fb_dims
            picture = np.empty((height, width, 3), dtype=np.float32)
            GL.glReadPixels(0, 0, width, height, GL.GL_RGB, GL.GL_FLOAT, picture)
            return picture

    class Studio(OffscreenRenderer):
        """One renderer and the scene around the camera: chunks of bore and patches of features that light can reach."""

        def __init__(self) -> None:
            super().__init__(64, 64)
            self._platform.make_current()
            self._renderer = RingRenderer(64, 64)
            self.scene = pyrender.Scene(bg_color=np.zeros(4), ambient_light=np.zeros(3))
            self.camera = self.scene.add(pyrender.IntrinsicsCamera(1, 1, 0, 0, znear=NEAREST_MM, zfar=10.0))
            self.projector = self.scene.add(RingProjector())
            self.material = pyrender.MetallicRoughnessMaterial(doubleSided=True)
            self.pipe: Pipe | None = None
            self.drawn: dict[tuple[str, int], tuple[Any, float]] = {}

        def __del__(self) -> None:
            """As of its renderer."""

        def draw(self, pipe: Pipe, T_pipe_camera: np.ndarray, rig: Rig, optics: Optics) -> np.ndarray:
            T_world_pipe = np.eye(4)
            T_world_pipe[2, 3] = -T_pipe_camera[2, 3]
            T_world_camera = T_world_pipe @ T_pipe_camera
            T_world_projector = T_world_camera @ rig.projector.T_camera_projector
            features = self._furnish(pipe, *reachable_mm(pipe, T_pipe_camera, rig, optics.glass), T_pipe_camera[2, 3])
            beam = light(rig.projector, optics)
            slide, slide_range = slide_table(beam)
            self._platform.make_current()
            self.projector.light.show(slide)
            bends = BENDS_PER_MM * optics.glass.thickness_mm
            T_projector_pipe = inverse(T_world_projector) @ T_world_pipe
            crop = shadow_crop(pipe, features, T_pipe_camera[2, 3], T_projector_pipe, beam.lit_to[-1], bends)
            self.scene.set_pose(self.camera, T_world_camera)
            self.scene.set_pose(self.projector, T_world_projector)
            self.projector.light.crop = crop or RingProjector.crop
            self._renderer.shaded = {
                n.mesh.primitives[0] for (kind, _), (n, _) in self.drawn.items() if kind == "feature"
            }
            self._renderer.effects = _effects(rig, beam, crop, optics.glass)
            self._renderer.uniforms = {
                **_camera_uniforms(rig.camera, pipe, T_pipe_camera),
                "slide_range": slide_range,
                **_beam_uniforms(beam),
                **_shadow_uniforms(crop or RingProjector.crop),
                "projector_world": inverse(T_world_projector),
                "camera_projector": rig.projector.T_camera_projector,
                "extent": _extent(pipe, T_pipe_camera),
                **_glass_uniforms(optics.glass, rig.projector.T_camera_projector),
                **_finish_uniforms(beam, optics.wall_reflectance),
            }
            self.viewport_width, self.viewport_height = rig.camera.width_px, rig.camera.height_px
            return self.render(self.scene, RenderFlags.SHADOWS_SPOT if crop else RenderFlags.NONE)

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
            primitive = pyrender.Primitive(
                positions=positions - [0, 0, z_mm],
                normals=normals,
                indices=piece.faces,
                material=self.material,
            )
            return self.scene.add(pyrender.Mesh([primitive])), z_mm

    return Studio


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


def _extent(pipe: Pipe, T_pipe_camera: np.ndarray) -> np.ndarray:
    shaded = 0.0 if pipe.bends else pipe.wall.smallest_radius + SHADED_BEYOND_MM
    beyond = 1e6 if pipe.backed else pipe.outer_radius_mm - HOLE_MM
    return np.array([shaded, beyond, pipe.start_mm - T_pipe_camera[2, 3], pipe.end_mm - T_pipe_camera[2, 3]])


def _camera_uniforms(camera: Camera, pipe: Pipe, T_pipe_camera: np.ndarray) -> dict[str, Any]:
    fx, fy, skew, cx, cy = camera.intrinsics[:5]
    farthest = 30 * pipe.outer_radius_mm + abs(T_pipe_camera[:2, 3]).max()
    return {
        "lens": np.array([fx, fy, cx, cy]),
        "lens_k": camera.intrinsics[5:],
        "picture": np.array([skew, camera.width_px, camera.height_px, farthest]),
    }


def _beam_uniforms(beam: Light) -> dict[str, Any]:
    return {
        "strut": np.array([beam.strut_azimuth_rad, beam.strut_half_width_rad, beam.strut_softness_rad, beam.jag_rad]),
        "slide_cells": float(beam.jag_cells),
        "falloff": np.array([beam.distance_power, beam.angle_power, REFERENCE_RANGE_MM, beam.housing_radius_mm]),
    }


def _shadow_uniforms(crop: tuple[float, ...]) -> dict[str, Any]:
    x, y, half, near, far = crop
    return {
        "crop": np.array([x, y, half, 0.0]),
        "depth_range": np.array([near, far, SHADOW_TEXELS, SHADOW_BIAS_MM]),
    }


def _glass_uniforms(glass: Glass, T_camera_projector: np.ndarray) -> dict[str, Any]:
    if glass.thickness_mm == 0:
        return {}
    tube = tube_of(glass)
    T_tube_camera = inverse(transform(np.array(tube.axes).T, np.array(tube.center)))
    return {
        "tube_camera": T_tube_camera,
        "tube_projector": T_tube_camera @ T_camera_projector,
        "tube": np.array([tube.inner, tube.outer, tube.refraction, tube.ghost]),
    }


def _finish_uniforms(beam: Light, reflectance: tuple[float, ...]) -> dict[str, Any]:
    if not _is_finished(beam):
        return {}
    return {
        "finish": np.array([beam.gloss, beam.gloss_power, beam.translucency, beam.translucency_mm]),
        "unpainted": np.array([1 / share if share > 0 else 0.0 for share in reflectance]),
    }


def _is_finished(beam: Light) -> bool:
    return beam.gloss > 0 or beam.translucency > 0


def _effects(rig: Rig, beam: Light, crop: tuple[float, ...] | None, glass: Glass) -> set[str]:
    """What the shader has to reckon with."""
    azimuth = np.linspace(0, 2 * np.pi, 72)
    tangent = beam.lit_from[0]
    rays = np.stack([tangent * np.sin(azimuth), -tangent * np.cos(azimuth), np.ones_like(azimuth)], axis=-1)
    T = rig.projector.T_camera_projector
    rays = rays @ T[:3, :3].T
    at_camera = T[:2, 3] - rays[:, :2] * (T[2, 3] / rays[:, 2])[:, None]
    housed = np.linalg.norm(at_camera, axis=1).min() < beam.housing_radius_mm + 0.1
    cases = {
        "HOUSED": housed,
        "SHADOWED": crop is not None,
        "JAGGED": beam.jag_rad > 0,
        "GLASS": glass.thickness_mm > 0,
        "FINISHED": _is_finished(beam),
    }
    return {name for name, matters in cases.items() if matters}
