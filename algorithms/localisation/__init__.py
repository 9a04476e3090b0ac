"""Estimators of where the sensor is along the pipe and how it is rolled: one file each, one line here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, NamedTuple

from pydantic import Field

from algorithms.localisation import accel, featured, fused, paper, slip
from algorithms.localisation.accel import AccelSettings
from algorithms.localisation.featured import FeaturedSettings
from algorithms.localisation.fused import FusedSettings
from algorithms.localisation.paper import PaperSettings
from algorithms.localisation.slip import SlipSettings


class Estimator(NamedTuple):
    """An estimator: its settings and its verbs, each from a state to the next, so that it works as frames come.

    `launch(frame, rig, pipe, axis_camera, settings)` makes the state of the first frame and `advance(state, frame,
    rig, settings)` that of the next; `predict(state)` gives the prior of the frame's alignment, and `settle(state,
    alignment)` takes the registered frame in. One that finds its place by the wall has `look(state, points, alignment,
    settings)`, which comes before and gives both back; one that looks back when the log has ended has
    `look_back(state)`, the path as it then seems, and `episodes(state)`, what was not as it should be.
    """

    settings: type[Any]
    launch: Callable[..., Any]
    advance: Callable[..., Any]
    predict: Callable[..., Any]
    settle: Callable[..., Any]
    look: Callable[..., Any] | None = None
    look_back: Callable[..., Any] | None = None
    episodes: Callable[..., Any] | None = None


ESTIMATORS = {
    "paper": Estimator(PaperSettings, paper.launch, paper.advance, paper.predict, paper.settle),
    "accel": Estimator(AccelSettings, accel.launch, accel.advance, accel.predict, accel.settle),
    "slip": Estimator(SlipSettings, paper.launch, slip.advance, paper.predict, paper.settle),
    "fused": Estimator(
        FusedSettings,
        fused.launch,
        fused.advance,
        fused.predict,
        fused.settle,
        look_back=fused.look_back,
        episodes=fused.episodes,
    ),
    "featured": Estimator(
        FeaturedSettings,
        featured.launch,
        featured.advance,
        featured.predict,
        featured.settle,
        look=featured.look,
        look_back=featured.look_back,
        episodes=featured.episodes,
    ),
}

AnyEstimator = Annotated[
    PaperSettings | AccelSettings | SlipSettings | FusedSettings | FeaturedSettings, Field(discriminator="kind")
]
