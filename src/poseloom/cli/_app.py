"""The command line's frame: the commands' register, and what becomes of errors.

Command modules import heavy parts inside their functions, so that `poseloom --help` answers at once.
"""

import errno
import io
import os
import sys
import warnings
from importlib import import_module
from importlib.util import find_spec
from typing import Annotated, Any

import typer

from poseloom.errors import PoseloomError
from poseloom.plugins import PluginWarning

TOPICS = (
    "demonstrating",
    "motion_files",
    "phases",
    "libraries",
    "sensing",
    "imus",
    "tracker_tables",
    "calibrating",
    "fitting",
    "flex_sensor",
    "live",
    "reconstruction",
    "evaluating",
    "viewing",
    "benchmarking",
)
"""Modules beside this one, each with `register(app)`, in the order of `poseloom --help`."""


def build_app() -> typer.Typer:
    """The application with all commands."""
    app = typer.Typer(
        name="poseloom",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_options)
    for topic in TOPICS:
        module = f"{__package__}.{topic}"
        if find_spec(module) is not None:
            import_module(module).register(app)
    return app


def run(argv: list[str]) -> int:
    """Runs one command line and returns its exit code.

    0 for success, 2 for a wrong command line, a PoseloomError or a file that the system refuses (each told on stderr
    without a traceback), 130 for an interrupt, 1 for a closed pipe. Any other exception is a defect of poseloom's and
    passes through.
    """
    _print_anything()
    try:
        return _run(argv)
    except PoseloomError as error:
        return _fail(str(error))
    except OSError as error:
        return 1 if _reader_gone(error) else _fail(_system_message(error))
    except KeyboardInterrupt:
        return 130
    finally:
        _close_stdout()


def _run(argv: list[str]) -> int:
    plain = warnings.showwarning

    def show(message: Warning | str, category: type[Warning], *place: Any) -> None:
        if issubclass(category, PluginWarning):
            print(f"poseloom: {message}", file=sys.stderr)
        else:
            plain(message, category, *place)

    warnings.showwarning = show
    try:
        typer.main.get_command(build_app()).main(args=argv, prog_name="poseloom")
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    finally:
        warnings.showwarning = plain
    return 0


def _print_version(wanted: bool) -> bool:
    if wanted:
        from poseloom import __version__

        typer.echo(f"poseloom {__version__}")
        raise typer.Exit
    return wanted


def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", is_eager=True, callback=_print_version)
    ] = False,
) -> None:
    """Full-body human motion from what a few body-worn sensors say."""


def _fail(message: str) -> int:
    sys.stderr.write(f"poseloom: {message}\n")
    return 2


def _system_message(error: OSError) -> str:
    reason = error.strerror or type(error).__name__
    return str(
        PoseloomError(
            "the system refused to read or write this file" if error.filename else "the system refused an operation",
            cause=reason if error.filename else str(error),
            remedy="Check that it exists, its permissions and the space on the disk",
            file=error.filename if isinstance(error.filename, str) else None,
        )
    )


def _print_anything() -> None:
    """Lets a letter that the terminal's or the pipe's encoding lacks (cp1252 on Windows) become `?`, not an error."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="replace")


def _reader_gone(error: OSError) -> bool:
    """Whether who read our output has gone away. Windows calls that an invalid argument, without a file."""
    return isinstance(error, BrokenPipeError) or (
        sys.platform == "win32" and error.errno == errno.EINVAL and error.filename is None
    )


def _close_stdout() -> None:
    # A reader that has gone away (`poseloom info x | head -1`) must not become a message when the interpreter exits.
    try:
        sys.stdout.flush()
    except OSError as error:
        if not _reader_gone(error):
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
