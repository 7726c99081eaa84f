"""Which method solves a recording again, and what about it is not as it was in the session."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from poseloom.errors import MethodError
from poseloom.formats.session_recording import SessionRecording
from poseloom.library import open_library
from poseloom.methods import DEFAULT_METHOD, make_method, needs_library, needs_model
from poseloom.methods.contract import Reconstructor


def method_for(
    session: SessionRecording, name: str | None = None, library: Path | None = None, model: Path | None = None
) -> tuple[Reconstructor[Any], str, tuple[str, ...]]:
    """The method for a recording; what is left out is as in the session.

    Args:
        session: The recording.
        name: Name of the method.
        library: Folder of the motion library.
        model: File of the fitted model.

    Returns:
        The method, its name, and what differs from the session in words.

    Raises:
        PoseloomError: if the method does not fit, or its library or model is not where the session had it.
    """
    recording = session.recording
    own = session.starts[0].method if session.starts else DEFAULT_METHOD
    chosen = name or own
    told: dict[str, Any] = json.loads(recording.settings.get("configuration", "{}"))
    layout, opened = recording.layout, None
    differences: list[str] = []
    methods = {start.method for start in session.starts}
    if len(methods) > 1:
        differences.append(f"the session went through {', '.join(sorted(methods))}; all of it is solved by {chosen}")
    if needs_library(chosen):
        folder = library or (Path(told["library"]) if told.get("library") else None)
        if folder is None:
            raise MethodError(f"the method {chosen!r} needs a motion library", remedy="Name it with --library")
        opened = open_library(folder)
        if recording.settings.get("library digest", opened.digest) != opened.digest:
            differences.append("this library's poses are not those that the session had")
        if opened.rate != layout.rate:
            differences.append(f"the library has {opened.rate:g} poses a second, the session had {layout.rate:g}")
            layout = replace(layout, rate=opened.rate)
    file = None
    if needs_model(chosen):
        file = model or (Path(told["model"]) if told.get("model") else None)
    return make_method(chosen, layout, opened, model=file), chosen, tuple(differences)
