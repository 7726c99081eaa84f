"""Options of a command made from the fields of `LiveSettings`, so that each setting is defined once."""

import inspect
from collections.abc import Callable
from dataclasses import Field, fields
from typing import Annotated, Any, TypeVar

import typer

from poseloom.live.settings import LiveSettings, facts_of

Command = TypeVar("Command", bound=Callable[..., Any])


def with_settings(command: Command) -> Command:
    """A command whose `**flags` are the fields of `LiveSettings`: each an option, None where it is not given."""
    own = inspect.signature(command)
    kept = [
        entry.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        for entry in own.parameters.values()
        if entry.kind is not inspect.Parameter.VAR_KEYWORD
    ]
    made = [_parameter(setting) for setting in fields(LiveSettings)]
    command.__signature__ = own.replace(parameters=[*made, *kept])  # pyright: ignore[reportFunctionMemberAccess]
    return command


def _parameter(setting: "Field[Any]") -> inspect.Parameter:
    facts = facts_of(setting)
    default: object = setting.default
    kind: Any = list[str] if isinstance(default, tuple) else type(default)
    names = [f"--{setting.name}", *([f"-{facts.short}"] if facts.short else [])]
    bounds = [None if bound is None else kind(bound) for bound in (facts.lowest, facts.highest)]
    option = typer.Option(*names, help=facts.help, metavar=facts.kind or None, min=bounds[0], max=bounds[1])
    return inspect.Parameter(
        setting.name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[kind | None, option]
    )
