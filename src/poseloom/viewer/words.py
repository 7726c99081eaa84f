"""The viewer's texts, as small pieces of HTML for its panels."""

import html
from collections.abc import Iterable, Mapping, Sequence

from poseloom.live.contract import (
    ArrivalStatus,
    CalibrationProgress,
    Counters,
    Finding,
    Latency,
    Level,
    Notice,
    SessionFacts,
)
from poseloom.methods.contract import Health, HealthState
from poseloom.viewer.colours import LOST, SILENT, STANDING, UNSURE, Colour, hexadecimal

HEALTH_COLOURS: Mapping[HealthState, Colour] = {
    HealthState.OK: STANDING,
    HealthState.DEGRADED: UNSURE,
    HealthState.COASTING: LOST,
    HealthState.LOST: LOST,
    HealthState.REJOINING: UNSURE,
}
NOTICE_COLOURS: Mapping[Level, Colour] = {Level.NOTE: STANDING, Level.WARNING: UNSURE, Level.ERROR: LOST}
_HEALTH_WORDS = {
    HealthState.OK: "all sensors speak",
    HealthState.DEGRADED: "without",
    HealthState.COASTING: "no sensor speaks; the motion is carried on",
    HealthState.LOST: "no sensor has spoken for long",
    HealthState.REJOINING: "sensors are back; the figure glides to them",
}


def box(text: str, margin: str = "0.2em 0.75em") -> str:
    """A paragraph of a panel."""
    return f'<div style="margin:{margin};font-size:0.875em;line-height:1.45">{text}</div>'


def dot(colour: Colour) -> str:
    """A coloured dot."""
    return (
        f'<span style="display:inline-block;width:0.7em;height:0.7em;border-radius:50%;margin-right:0.45em;'
        f'background:{hexadecimal(colour)}"></span>'
    )


def health_text(health: Health | None) -> str:
    """What a frame's health means."""
    if health is None:
        return f"{dot(SILENT)}<b>waiting</b> for the first pose"
    words = _HEALTH_WORDS[health.state]
    names = f" {html.escape(', '.join(health.sensors))}" if health.state is HealthState.DEGRADED else ""
    return f"{dot(HEALTH_COLOURS[health.state])}<b>{health.state.value}</b>: {words}{names}"


def status_text(facts: SessionFacts, health: Health | None, latency: Latency, counters: Counters) -> str:
    """The session in two lines."""
    delay = f" + {latency.look_ahead:.0f} look-ahead" if latency.look_ahead else ""
    recording = ""
    if facts.recording is not None:
        recording = f"<br>{dot(LOST)}recording to {html.escape(facts.recording.name)}"
    return box(
        f"{health_text(health)}<br>"
        f'<span style="opacity:0.75">{counters.rate:.0f} samples/s, {latency.p50:.1f} ms to a pose '
        f"(95 %: {latency.p95:.1f} ms{delay})</span>{recording}"
    )


def findings_text(findings: Sequence[Finding]) -> str:
    """What is wrong with sensors."""
    if not findings:
        return ""
    lines = "<br>".join(f"{dot(LOST)}{html.escape(finding.text)}" for finding in findings)
    return box(lines)


def arrivals_text(arrivals: ArrivalStatus | None) -> str:
    """What arrives from where, what is missing and what to do."""
    if arrivals is None:
        return ""
    return box(f"{dot(NOTICE_COLOURS[arrivals.level])}{html.escape(_sentences(arrivals.text))}")


def _sentences(text: str) -> str:
    return text[:1].upper() + text[1:]


def notice_text(notice: Notice) -> str:
    """What has just happened."""
    return box(f"{dot(NOTICE_COLOURS[notice.level])}{html.escape(notice.text)}")


def sensor_table(facts: SessionFacts, status: Iterable[int], findings: Sequence[Finding]) -> str:
    """A line for each sensor: its name, its bone and how it is."""
    trouble = {finding.sensor: finding.trouble.value for finding in findings}
    rows: list[str] = []
    for sensor, state in zip(facts.layout.sensors, status, strict=True):
        word = trouble.get(sensor.name) or ("ok" if state == 0 else "no reading")
        colour = LOST if sensor.name in trouble else STANDING if state == 0 else SILENT
        name, bone = html.escape(sensor.name), html.escape(sensor.bone)
        place = "" if name == bone else f' <span style="opacity:0.6">on {bone}</span>'
        rows.append(f"<tr><td>{dot(colour)}{name}{place}</td><td>{html.escape(word)}</td></tr>")
    return box(f'<table style="width:100%">{"".join(rows)}</table>')


def counters_text(counters: Counters, facts: SessionFacts) -> str:
    """What came and what became of it."""
    measured = "measured on the wearer" if facts.calibrated else "of average size: not calibrated"
    return box(
        f'<div style="opacity:0.75">{html.escape("; ".join(facts.sources))}<br>'
        f"{counters.packets} packets, {counters.malformed} not understood, {counters.stale} too late<br>"
        f"{counters.samples} samples, {counters.dropped} skipped, {counters.filled} without readings<br>"
        f"Body {measured}</div>"
    )


def guide_text(progress: CalibrationProgress) -> str:
    """What to do in a guided calibration, to be read from two metres away."""
    if progress.phase == "computing":
        return box('<div style="font-size:1.5em;font-weight:600">Computing …</div>', "0.6em 0.75em")
    hold = progress.phase == "hold"
    colour = hexadecimal(STANDING if hold else UNSURE)
    seconds = max(1, round(progress.remaining + 0.49))
    return box(
        f'<div style="display:flex;justify-content:space-between;align-items:center;gap:0.6em">'
        f'<div><div style="opacity:0.7">Pose {progress.step} of {progress.steps}</div>'
        f'<div style="font-size:1.5em;font-weight:600;line-height:1.2">{html.escape(progress.title)}</div>'
        f'<div style="color:{colour};font-weight:600">{html.escape(progress.phase)}</div></div>'
        f'<div style="font-size:3em;font-weight:700;color:{colour}">{seconds}</div></div>'
        f"<div>{html.escape(progress.instruction)}</div>",
        "0.6em 0.75em",
    )
