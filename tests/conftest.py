"""What all tests share: array shapes and types checked at every call of ours, and where the reference data lies."""

from __future__ import annotations

import ast
import importlib.util
import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import jaxtyping._import_hook as hook
import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ["twin", "sensor_model", "algorithms", "scenarios"]
TYPECHECKER = "beartype.beartype"


class _SkipCompiled(hook.JaxtypingTransformer):
    """Checks every function but the ones numba compiles, which cannot be wrapped."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        return (
            node if any(_is_njit(decorator) for decorator in node.decorator_list) else super().visit_FunctionDef(node)
        )


def _is_njit(decorator: ast.expr) -> bool:
    target = decorator.func if isinstance(decorator, ast.Call) else decorator
    name = target.attr if isinstance(target, ast.Attribute) else getattr(target, "id", "")
    return name in ("njit", "jit", "vectorize", "guvectorize", "cfunc")


# before the first import of ours; the bytecode is kept under the hook's own name, apart from the plain one
hook.JaxtypingTransformer = _SkipCompiled
hook.install_import_hook(PACKAGES, TYPECHECKER)


@pytest.fixture(scope="session")
def shared() -> Path:
    """The reference data, beside the repository or where PIPETWIN_SHARED says; without it the test is skipped."""
    given = os.environ.get("PIPETWIN_SHARED")
    for folder in [Path(given)] if given else [ROOT / "shared", ROOT.parent / "shared"]:
        if (folder / "reference").is_dir():
            return folder
    pytest.skip("no reference data: put it beside the repository as ../shared, or name it in PIPETWIN_SHARED")


@pytest.fixture(scope="session")
def campaign() -> Callable[[str], ModuleType]:
    """Loads a script of `campaigns/`, which is no package, by its name."""

    def load(name: str) -> ModuleType:
        spec = importlib.util.spec_from_file_location(name, ROOT / "campaigns" / f"{name}.py")
        assert spec is not None
        assert spec.loader is not None
        module = sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return load
