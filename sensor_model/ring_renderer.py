"""pyrender with our shaders: the projector as a spot light with a shadow, tables, passes and a float buffer."""

from __future__ import annotations

import os
import warnings
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

SHADERS = Path(__file__).parent / "shaders"
SHADOW_TEXELS = 2048
BENDING = {"tube", "tube_projector", "water", "water_projector"}  # uniforms that move what the projector sees
NO_SHADOW = (0.0, 0.0, 1.0, 1.0, 2.0)


def prepare_gl() -> Any:
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


class GlClasses(NamedTuple):
    """Classes over pyrender's, which can be made only once it is imported."""

    RingProjector: Any
    RingScreen: Any


@cache
def gl_classes() -> GlClasses:
    """Made when pyrender is first imported."""
    prepare_gl()
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

    class Table:
        """A texture of plain numbers, which the shaders look up texel by texel."""

        def __init__(self) -> None:
            self.number = GL.glGenTextures(1)

        def show(self, table: np.ndarray) -> None:
            """Put numbers in, (rows, columns, 4) float32."""
            self._bind()
            rows, columns, _ = table.shape
            GL.glTexImage2D(GL.GL_TEXTURE_2D, 0, GL.GL_RGBA32F, columns, rows, 0, GL.GL_RGBA, GL.GL_FLOAT, table)
            for side in (GL.GL_TEXTURE_MIN_FILTER, GL.GL_TEXTURE_MAG_FILTER):
                GL.glTexParameteri(GL.GL_TEXTURE_2D, side, GL.GL_NEAREST)

        def _bind(self) -> None:
            GL.glBindTexture(GL.GL_TEXTURE_2D, self.number)

    class RingProjector(SpotLight):
        """The projector: a spot light whose node has its axes, with a shadow map cropped to what can be shaded."""

        crop: tuple[float, ...] = NO_SHADOW

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
            self.tables: dict[str, Table] = {}
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
                defines |= {"DEPTH": 1, **dict.fromkeys(self.effects & {"BENT", "GLASS", "WATER"}, 1)}
            program = self._program_cache.get_program("mesh.vert", fragments, defines=defines)
            if not program._in_context():
                program._add_to_context()
            if "DEPTH" in defines:  # no lights are bound in that pass
                program._bind()
                for name in self.uniforms.keys() & BENDING:
                    program.set_uniform(name, self.uniforms[name])
            return program

        def _bind_lighting(self, scene: Any, program: Any, node: Any, flags: int) -> None:  # noqa: ARG002
            (projector,) = scene.spot_light_nodes
            if flags & RenderFlags.SHADOWS_SPOT:
                self._bind_texture(projector.light.shadow_texture, "shadow_map", program)
            for name, table in self.tables.items():
                self._bind_texture(table, name, program)
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
            channels, kind = (4, GL.GL_RGBA) if "WATER" in self.effects else (3, GL.GL_RGB)
            picture = np.empty((height, width, channels), dtype=np.float32)
            GL.glReadPixels(0, 0, width, height, kind, GL.GL_FLOAT, picture)
            return picture

    class RingScreen(OffscreenRenderer):
        """The one renderer of a process, off screen."""

        def __init__(self) -> None:
            super().__init__(64, 64)
            self._platform.make_current()
            self._renderer = RingRenderer(64, 64)

        def __del__(self) -> None:
            """As of its renderer."""

        def picture(
            self,
            scene: Any,
            size: tuple[int, int],
            tables: dict[str, np.ndarray],
            uniforms: dict[str, Any],
            effects: set[str],
            shaded: set[Any],
        ) -> np.ndarray:
            """The scene as it is seen, (height, width, 3) float32; with water (height, width, 4), 0 where that is."""
            self._platform.make_current()
            for name, table in tables.items():
                self._renderer.tables.setdefault(name, Table()).show(table)
            self._renderer.uniforms, self._renderer.effects, self._renderer.shaded = uniforms, effects, shaded
            self.viewport_width, self.viewport_height = size
            return self.render(scene, RenderFlags.SHADOWS_SPOT if "SHADOWED" in effects else RenderFlags.NONE)

    return GlClasses(RingProjector, RingScreen)
