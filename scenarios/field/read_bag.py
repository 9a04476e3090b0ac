"""A ROS 2 bag or an MCAP file as a recording: topics by their types or a mapping, stamps from the messages' headers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from scenarios.calibration.rig_file import read_settings
from scenarios.document import BadInput
from scenarios.field import ros
from scenarios.field.bag_files import Bag, bag_messages, open_bag
from scenarios.field.gather import TAKERS, Gathered, write_gathered
from scenarios.field.raw_messages import LARGEST_MESSAGE_BYTES, Raw
from scenarios.field.told import Told, needed
from scenarios.run import Report
from sensor_model.recording import NominalPipe
from sensor_model.rig import MAX_SETTINGS_BYTES, AnySettings, Rig
from sensor_model.settings import Settings

SAY_EVERY = 2000

Topic = Annotated[str, Field(pattern="^/", max_length=255)] | None


class Topics(Settings):
    """Which topics hold what; one that is not named is found by its type, where only one topic has that type.

    `wheels` are the names of the encoder wheels' joints in the rig's order; empty: as the first message has them.
    """

    picture: Topic = None
    slit_pixels: Topic = None
    imu: Topic = None
    attitude: Topic = None
    encoders: Topic = None
    wheels: Annotated[tuple[str, ...], Field(max_length=16)] = ()
    rig: Topic = None
    pipe: Topic = None


KINDS: dict[str, tuple[str, ...]] = {
    "picture": (ros.PICTURE, ros.IMAGE),
    "slit_pixels": (ros.SLITS,),
    "imu": (ros.IMU,),
    "attitude": (ros.ATTITUDE,),
    "encoders": (ros.WHEELS,),
}
NAMED = {"rig": "/rig", "pipe": "/pipe"}  # text of this type may be anything: only by name


def read_bag(log: Path, told: Told, target: Path, progress: Report) -> list[str]:
    """Write a bag's measurements as a recording.

    Raises:
        BadInput: naming the topic and the message for what cannot be used.
    """
    topics = read_settings(Topics, told.topics) if told.topics else Topics()
    (target / "cam0" / "data").mkdir(parents=True)
    with open_bag(log, target) as bag:
        return _gathered(log, bag, told, topics, target, progress)


def _gathered(log: Path, bag: Bag, told: Told, topics: Topics, target: Path, progress: Report) -> list[str]:
    remarks: list[str] = []
    held, texts, total = _contents(log, bag, topics)
    rig, pipe = needed(_with_own_words(told, texts, log), log)
    chosen = {role: topic for role in KINDS if (topic := _topic(role, getattr(topics, role), held, log))}
    _check_complete(chosen, log)
    gathered = Gathered(target, rig, topics.wheels, "attitude" in chosen)
    roles = {topic: role for role, topic in chosen.items()}
    numbers = dict.fromkeys(roles, 0)
    for done, raw in enumerate(bag_messages(bag, remarks), start=1):
        if raw.topic in roles:
            numbers[raw.topic] += 1
            where = f"{log}: {raw.topic}, message {numbers[raw.topic]}"
            TAKERS[roles[raw.topic]](gathered, _understood(raw, where), where)
        if done % SAY_EVERY == 0 or done == total:
            progress("read", done, total)
    return remarks + write_gathered(gathered, pipe, log)


def _contents(log: Path, bag: Bag, topics: Topics) -> tuple[dict[str, str], dict[str, str], int]:
    """Every topic with its type, the texts of those that hold rig and pipe, and how many messages there are."""
    named = {getattr(topics, role) or topic: role for role, topic in NAMED.items()}
    held: dict[str, str] = {}
    texts: dict[str, str] = {}
    total = 0
    for raw in bag_messages(bag, []):
        total += 1
        held.setdefault(raw.topic, raw.kind)
        if raw.kind == ros.TEXT and raw.topic in named and len(raw.content) <= MAX_SETTINGS_BYTES:
            texts[named[raw.topic]] = str(_understood(raw, f"{log}: {raw.topic}").data)
    return held, texts, total


def _with_own_words(told: Told, texts: dict[str, str], log: Path) -> Told:
    """What the log says of rig and pipe, where the operator does not."""
    return told._replace(
        rig=told.rig or _from_text(Rig, "rig", texts, log),
        pipe=told.pipe or _from_text(NominalPipe, "pipe", texts, log),
    )


def _from_text(kind: type[AnySettings], name: str, texts: dict[str, str], log: Path) -> AnySettings | None:
    if name not in texts:
        return None
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{name}.yaml"
        file.write_text(texts[name])
        try:
            return read_settings(kind, file)
        except BadInput as error:
            raise BadInput([line.replace(str(file), f"{log}: /{name}") for line in error.lines]) from error


def _topic(role: str, named: str | None, held: dict[str, str], log: Path) -> str | None:
    """The topic of a role: the one that was named, or called as in our own bags, or else the only one of its types."""
    fitting = [topic for topic, kind in held.items() if kind in KINDS[role]]
    if named is not None:
        if named not in fitting:
            has = f"has {held[named]}" if named in held else "is not in the bag"
            raise BadInput([f"{log}: topic {named} of {role} {has}; {' or '.join(KINDS[role])} is expected"])
        return named
    own = [topic for topic in fitting if topic in ros.OURS]
    if len(own) == 1:
        return own[0]
    if len(fitting) > 1:
        raise BadInput(
            [f"{log}: {role}: got {', '.join(sorted(fitting))}; say which by --topics, a file of `{role}: TOPIC`"]
        )
    return fitting[0] if fitting else None


def _check_complete(chosen: dict[str, str], log: Path) -> None:
    lacking = [f"{role} ({' or '.join(KINDS[role])})" for role in ("imu", "encoders") if role not in chosen]
    if "picture" not in chosen and "slit_pixels" not in chosen:
        lacking.append(f"picture ({' or '.join(KINDS['picture'])})")
    if lacking:
        raise BadInput([f"{log}: no topic for {item}" for item in lacking])
    if "picture" in chosen and "slit_pixels" in chosen:
        raise BadInput([f"{log}: has pictures and slit pixels; say which by --topics"])


def _understood(raw: Raw, where: str) -> Any:
    """The message that some bytes are.

    Raises:
        BadInput: when they are none.
    """
    if len(raw.content) > LARGEST_MESSAGE_BYTES:
        raise BadInput([f"{where}: {len(raw.content)} bytes; at most {LARGEST_MESSAGE_BYTES}"])
    types = ros.types()
    try:
        return types.deserialize_cdr(raw.content, raw.kind)
    except Exception as error:  # whatever a broken message makes of the generated reader
        raise BadInput([f"{where}: got no {raw.kind}: {type(error).__name__}: {error}"]) from error
