"""The HTML report in a real browser, and the still pictures."""

import base64
import json
import re
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from browsing import chromium, open_browser
from poseloom.errors import PoseloomError
from poseloom.evaluation.results import MethodResult, SequenceResult, compare, mean_over_sequences
from poseloom.report import page_data
from poseloom.report.html import write_report
from poseloom.report.strip import StripRow, sequence_strip, strip_svg
from poseloom.skeleton.body import BODY_BONES, average_body
from poseloom.skeleton.mannequin import limbs
from poseloom.skeleton.motion import Motion, make_motion

RATE = 40.0


def column(bone: str, axis: int) -> int:
    return 3 + 3 * BODY_BONES.index(bone) + axis


def walk(frames: int, name: str) -> Motion:
    time = np.arange(frames) / RATE
    swing = np.sin(2 * np.pi * 0.95 * time)
    q = np.zeros((frames, average_body().size))
    q[:, 1], q[:, 2] = 0.94, 1.2 * time
    for side, sign in (("left", 1), ("right", -1)):
        q[:, column(f"{side}UpperLeg", 0)] = -0.1 - 0.4 * sign * swing
        q[:, column(f"{side}LowerLeg", 0)] = 0.4 + 0.3 * sign * swing
        q[:, column(f"{side}UpperArm", 2)] = -1.3 * sign
        q[:, column(f"{side}LowerArm", 1)] = -sign * (0.4 + 0.2 * sign * swing)
    return make_motion(average_body(), q, RATE, name)


def result(truth: Motion, name: str, size: float, skipped: int = 0) -> MethodResult:
    draw = np.random.default_rng(7)
    samples = np.arange(skipped, len(truth))
    turns = draw.normal(0, size, truth.q.shape[1])
    turns[:6] = 0
    estimate = make_motion(truth.skeleton, truth.q[samples] + turns, RATE, truth.name)
    return compare(name, truth, estimate, samples, draw.gamma(9, 1e-4, len(truth)), delay=0)


@pytest.fixture(scope="module")
def sequences() -> tuple[SequenceResult, ...]:
    truths = [walk(120, "a walk"), walk(90, "another </script> walk")]
    return tuple(SequenceResult(t.name, t, (result(t, "good", 0.05, skipped=5), result(t, "bad", 0.2))) for t in truths)


@pytest.fixture(scope="module")
def report(sequences: tuple[SequenceResult, ...], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    facts = {"data": "two walks", "split": "none", "seed": "7"}
    write_report(path, sequences, "Truth & estimate", ["Made <b>by a test</b>."], facts)
    return path


def decoded(text: str, dtype: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype=dtype)


def test_the_page_holds_the_motions_to_a_hundredth_of_a_degree(sequences: tuple[SequenceResult, ...]) -> None:
    data = page_data.page_data(sequences)
    for entry, sequence in zip(data["sequences"], sequences, strict=True):
        track = entry["truth"]
        turns = decoded(track["rotvecs"], "<i2").reshape(len(sequence.truth), -1) * track["scale"]
        assert np.abs(turns - sequence.truth.q[:, 3:]).max() < np.radians(0.01)
        root = decoded(track["root"], "<f4").reshape(-1, 3)
        assert np.allclose(root, sequence.truth.root_positions, atol=1e-5)


def test_frames_that_a_method_did_not_speak_of_are_absent(sequences: tuple[SequenceResult, ...]) -> None:
    first = page_data.page_data(sequences)["sequences"][0]["results"][0]
    present = decoded(first["track"]["present"], "u1")
    angle = decoded(first["errors"]["angle"], "<f4")
    assert not present[:5].any()
    assert present[5:].all()
    assert np.isnan(angle[:5]).all()
    assert angle[5:].mean() == pytest.approx(first["metrics"]["joint_angle_deg"], rel=1e-4)
    assert len(decoded(first["track"]["root"], "<f4")) == 3 * 120


def test_a_page_of_many_sequences_stays_small_and_tells_all_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_data, "BUDGET", 2 * 90)
    truths = [walk(60, f"walk {i}") for i in range(3)]
    data = page_data.page_data([SequenceResult(t.name, t, (result(t, "good", 0.05),)) for t in truths])
    whole, cut, figures_only = data["sequences"]
    assert whole["frames"] == 60
    assert cut["frames"] == 30
    assert cut["name"] == "walk 1 (the first 1 s)"
    assert figures_only["truth"] is None
    assert figures_only["results"][0]["metrics"]["joint_angle_deg"] > 0
    assert data["methods"][0]["metrics"]["joint_angle_deg"]["spread"] is not None


def test_means_are_over_sequences_and_leave_out_what_is_not_defined(sequences: tuple[SequenceResult, ...]) -> None:
    means = mean_over_sequences(sequences)
    values = [sequence.results[1].metrics["joint_angle_deg"] for sequence in sequences]
    assert means["bad"]["joint_angle_deg"].value == pytest.approx(np.mean(values))
    assert means["bad"]["joint_angle_deg"].spread == pytest.approx(np.std(values, ddof=1))
    assert means["bad"]["joint_angle_deg"].sequences == 2
    assert means["bad"]["joint_angle_deg"].frames == 210
    still = make_motion(average_body(), np.zeros((3, 69)), RATE, "still")
    alone = mean_over_sequences([SequenceResult("still", still, (compare("m", still, still),))])["m"]
    assert alone["joint_angle_deg"] == (0.0, None, 1, 3)
    assert "jitter_deg_s3" not in alone
    assert "step_ms_p50" not in alone


def test_samples_outside_the_truth_are_refused() -> None:
    truth = walk(10, "short")
    with pytest.raises(PoseloomError, match="frames 5 to 14"):
        compare("late", truth, truth, np.arange(5, 15))


def test_a_report_of_nothing_is_refused_and_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text("old")
    with pytest.raises(PoseloomError, match="at least one sequence"):
        write_report(path, [SequenceResult("empty", walk(5, "empty"), ())], "nothing")
    assert path.read_text() == "old"


def test_the_file_is_small_and_names_no_host(report: Path) -> None:
    text = report.read_text(encoding="utf-8")
    assert len(text) < 8e6
    own = re.sub(r"<script>/\*.*?plotly.*?</script>", "", text, count=1, flags=re.S | re.I)
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", own)
    assert "Truth &amp; estimate" in text
    assert "&lt;b&gt;by a test" in text


# --- the body --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [0.8, 1.0, 1.2])
def test_limbs_are_sound_and_the_same_left_and_right(size: float) -> None:
    body = average_body().with_offsets(size * average_body().offsets, size * average_body().tips)
    parts = limbs(body)
    assert {part.bone for part in parts} == set(range(len(BODY_BONES)))
    for part in parts:
        axis = part.end - part.start
        assert np.linalg.norm(axis) > 0
        assert part.side @ axis == pytest.approx(0.0, abs=1e-12)
        assert np.linalg.norm(part.side) == pytest.approx(1.0)
        assert (part.radii > 0).all()
    mirror = np.array([-1.0, 1.0, 1.0])
    for left in (part for part in parts if BODY_BONES[part.bone].startswith("left")):
        other = BODY_BONES.index(BODY_BONES[left.bone].replace("left", "right"))
        assert any(
            np.allclose(right.start, left.start * mirror)
            and np.allclose(right.end, left.end * mirror)
            and np.allclose(right.radii, left.radii)
            for right in parts
            if right.bone == other
        )


def test_the_soles_of_the_standing_body_are_its_lowest_points() -> None:
    body = average_body()
    rest = body.rest_positions()
    lowest = dict.fromkeys(BODY_BONES, np.inf)
    for part in limbs(body):
        bottom = min(part.start[1] - part.radii[:2].min(), part.end[1] - part.radii[2:].min())
        lowest[BODY_BONES[part.bone]] = min(lowest[BODY_BONES[part.bone]], rest[part.bone, 1] + bottom)
    ankle = rest[BODY_BONES.index("leftFoot"), 1]
    assert lowest["leftFoot"] == pytest.approx(ankle - 0.072, abs=0.012)
    assert lowest["leftToes"] == pytest.approx(ankle - 0.053, abs=0.012)
    assert min(lowest.values()) in (lowest["leftFoot"], lowest["leftToes"])


def test_the_strip_is_sound_svg_with_a_figure_a_moment() -> None:
    truth = walk(80, "walk")
    text = strip_svg([StripRow("truth <1>", truth, "#808080"), StripRow("estimate", truth, "#0072b2")], moments=4)
    root = ElementTree.fromstring(text)
    space = "{http://www.w3.org/2000/svg}"
    figures = root.findall(f"{space}g")
    assert len(figures) == 8
    for figure in figures:
        assert len(figure.findall(f"{space}path")) == len(limbs(truth.skeleton)) + 1
    labels = [node.text for node in root.findall(f"{space}text")]
    assert labels == ["truth <1>", "estimate", "0.0 s", "0.7 s", "1.3 s", "2.0 s"]
    numbers = [float(n) for path in root.iter(f"{space}path") for n in re.findall(r"-?\d+\.?\d*", path.get("d", ""))]
    assert np.abs(numbers).max() < 400
    assert len(strip_svg([StripRow("one frame", truth.cut(0, 1), "#808080")])) > 1000


def test_a_sequence_is_drawn_over_the_time_that_all_methods_speak_of(sequences: tuple[SequenceResult, ...]) -> None:
    root = ElementTree.fromstring(sequence_strip(sequences[0], moments=3))
    labels = [node.text for node in root.findall("{http://www.w3.org/2000/svg}text")]
    assert labels == ["truth", "good", "bad", "0.0 s", "1.4 s", "2.9 s"]


# --- in a browser ----------------------------------------------------------------------------------------------------


class Browser:
    """A page, and whatever it complained of or asked the network for."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.complaints: list[str] = []
        page.on("console", lambda m: self.complaints.append(m.text) if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", self._request)

    def _request(self, request: Any) -> None:
        if not request.url.startswith(("file:", "data:", "blob:")):
            self.complaints.append(f"asked for {request.url}")

    def open(self, path: Path, fragment: str = "") -> "Browser":
        self.page.goto("about:blank")
        self.complaints.clear()
        self.page.goto(path.as_uri() + fragment)
        self.page.wait_for_selector("#time-plot .main-svg")
        return self

    def pixels(self) -> np.ndarray:
        """The canvas as (rows, columns, 3) numbers, drawn anew."""
        values, width = self.page.evaluate(
            """() => {
                stage.draw();
                const copy = document.createElement("canvas"), from = stage.canvas;
                copy.width = from.width; copy.height = from.height;
                const context = copy.getContext("2d");
                context.drawImage(from, 0, 0);
                const data = context.getImageData(0, 0, copy.width, copy.height).data;
                let text = "";
                for (let i = 0; i < data.length; i += 4) text += String.fromCharCode(data[i], data[i + 1], data[i + 2]);
                return [btoa(text), copy.width];
            }"""
        )
        return decoded(values, "u1").reshape(-1, width, 3).astype(np.int64)

    def frame(self) -> float:
        return float(self.page.evaluate("state.frame"))


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    chromium()  # or skip
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        context = open_browser(playwright, tmp_path_factory.mktemp("profile"), 1280, 800)
        yield Browser(context.pages[0])
        context.close()


def bluish(pixels: np.ndarray) -> np.ndarray:
    return pixels[..., 2] > pixels[..., 0] + 60


def orange(pixels: np.ndarray) -> np.ndarray:
    return pixels[..., 0] > pixels[..., 2] + 60


def wait_until(page: Any, condition: str) -> None:
    """Until something is so on the page, whose rules forbid Playwright's own waiting for a text of JavaScript."""
    end = time.monotonic() + 90.0
    while not page.evaluate(condition):
        assert time.monotonic() < end, condition
        page.wait_for_timeout(20)


@pytest.mark.parametrize("fragment", ["", "#flat"])
def test_figures_are_drawn_and_move(browser: Browser, report: Path, fragment: str) -> None:
    page = browser.open(report, fragment).page
    kind = page.evaluate("stage.painter.constructor.name")
    assert kind == ("FlatPainter" if fragment else "WebglPainter")
    page.evaluate("seek(20)")
    before = browser.pixels()
    third = before.shape[1] // 3
    # Side by side: truth, then the two methods in their colours, each in its own panel.
    assert bluish(before).sum() > 0.02 * before[:, :third].shape[0] * third
    assert bluish(before)[:, :third].sum() == 0
    assert orange(before)[:, 2 * third + 2 :].sum() > 0.5 * orange(before).sum() > 100
    page.click("#play")
    wait_until(page, "state.frame > 22")
    page.click("#play")
    after = browser.pixels()
    assert (np.abs(after - before).sum(axis=-1) > 30).mean() > 0.005
    assert browser.complaints == []


def test_scrubbing_keys_and_the_plot_seek(browser: Browser, report: Path) -> None:
    page = browser.open(report).page
    box = page.locator("#scrub").bounding_box()
    page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    assert browser.frame() == pytest.approx(59.5, abs=3)
    middle = page.locator("#cursor").bounding_box()["x"]
    page.keyboard.press("Home")
    assert browser.frame() == 0
    first = page.locator("#cursor").bounding_box()["x"]
    page.keyboard.press("Shift+ArrowRight")
    page.keyboard.press("ArrowLeft")
    assert browser.frame() == 39
    page.keyboard.press("End")
    last = page.locator("#cursor").bounding_box()["x"]
    assert middle - first == pytest.approx(last - middle, rel=0.1)
    plot = page.locator("#time-plot .nsewdrag").bounding_box()
    page.mouse.click(plot["x"] + 0.25 * plot["width"], plot["y"] + 0.3 * plot["height"])
    wait_until(page, "Math.abs(state.frame - 0.25 * 119) <= 2")
    page.keyboard.press(" ")
    assert page.evaluate("state.playing")
    page.keyboard.press(" ")
    assert browser.complaints == []


def test_overlay_colouring_and_turning(browser: Browser, report: Path) -> None:
    page = browser.open(report).page
    page.evaluate("seek(20)")
    apart = browser.pixels()
    page.click("#over")
    together = browser.pixels()
    third = together.shape[1] // 3
    assert bluish(apart)[:, third : 2 * third].any()
    assert not bluish(together)[:, : third // 2].any()
    page.click("#heat")
    heated = browser.pixels()
    assert bluish(heated).sum() < 0.2 * bluish(together).sum()
    assert page.locator("#heat-scale").is_visible()
    page.click("#heat")
    page.locator("label", has_text="bad").locator("input").uncheck()
    assert orange(browser.pixels()).sum() < 0.2 * orange(together).sum()
    stage = page.locator("#figure").bounding_box()
    page.mouse.move(stage["x"] + 300, stage["y"] + 150)
    page.mouse.down()
    page.mouse.move(stage["x"] + 420, stage["y"] + 160, steps=4)
    page.mouse.up()
    assert page.evaluate("stage.camera.yaw") != pytest.approx(0.62)
    assert (np.abs(browser.pixels() - together).sum(axis=-1) > 30).mean() > 0.01
    page.click("#view")
    assert page.evaluate("stage.camera.yaw") == pytest.approx(0.62)
    assert browser.complaints == []


def test_plots_and_tables_tell_the_figures(
    browser: Browser, report: Path, sequences: tuple[SequenceResult, ...]
) -> None:
    page = browser.open(report).page
    assert page.title() == "Truth & estimate"
    assert page.evaluate("document.querySelector('#time-plot').data.map(t => t.name)") == ["good", "bad"]
    assert len(page.evaluate("document.querySelector('#joint-plot').data[0].x")) == 20
    assert page.evaluate("document.querySelector('#step-plot').data.length") == 2
    means = mean_over_sequences(sequences)
    row = page.locator("#summary tr", has_text="joint angle").inner_text()
    assert f"{means['good']['joint_angle_deg'].value:.2f}" in row
    assert f"{means['bad']['joint_angle_deg'].spread:.2f}"[:4] in row
    assert page.locator("#summary tr", has_text="joint angle").locator("td.best").count() == 1
    page.select_option("#measure", "position")
    assert page.locator(".big strong").first.inner_text().endswith("cm")
    page.click("#sequences button >> nth=1")
    assert page.evaluate("scene.frames") == 90
    assert page.locator("#sequence option >> nth=1").inner_text() == "another </script> walk"
    page.click("#all-of-them")
    assert browser.complaints == []


def test_the_page_fits_a_phone(browser: Browser, report: Path) -> None:
    page = browser.page
    page.set_viewport_size({"width": 390, "height": 844})
    try:
        browser.open(report)
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        page.evaluate("seek(20)")
        assert bluish(browser.pixels()).sum() > 500
        assert page.locator("#play").bounding_box()["y"] < 844
        assert browser.complaints == []
    finally:
        page.set_viewport_size({"width": 1280, "height": 800})


def test_the_data_survives_as_json(report: Path) -> None:
    text = report.read_text(encoding="utf-8")
    data = json.loads(re.search(r'id="report-data">(.*?)</script>', text, re.S)[1])
    assert data["sequences"][1]["name"] == "another </script> walk"
