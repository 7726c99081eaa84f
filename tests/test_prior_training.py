"""Training the learnt prior: people kept apart, virtual sensors against samples, losses, resuming, and NumPy's step."""

import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseloom.errors import FormatError, PoseloomError
from poseloom.methods.prior.channels import ANY, RATE, SIX, SIX_BONES, CalibrationPose, Channel, body_sizes
from poseloom.methods.prior.intake import PriorIntake
from poseloom.methods.prior.model_file import read_prior
from poseloom.methods.prior.network import PriorNetwork
from poseloom.rotations import quat_from_matrix, rotvec_from_matrix
from poseloom.sensors.layout import SensorKind, SensorSpec, make_layout
from poseloom.sensors.placement import default_placements
from poseloom.sensors.sample import Sample
from poseloom.skeleton.body import BODY_BONES, average_body
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.mirror import mirror_pose_vectors
from poseloom.skeleton.motion import make_motion

torch = pytest.importorskip("torch", reason="torch is not installed (extra `train`)")

from poseloom.training.prior import kinematics  # noqa: E402
from poseloom.training.prior.export import CONDITIONS, export_prior, weights_of  # noqa: E402
from poseloom.training.prior.judging import Conditions, judge, judging_batch, sigma_factors  # noqa: E402
from poseloom.training.prior.kinematics import (  # noqa: E402
    global_rotations,
    joint_offsets,
    matrix_from_columns,
    matrix_from_rotvec,
    mirror,
)
from poseloom.training.prior.loop import PriorSettings, draw_batch, rate_at, train_prior  # noqa: E402
from poseloom.training.prior.losses import LossWeights, loss_parts, total_loss  # noqa: E402
from poseloom.training.prior.motions import LEAD, MotionPool, Motions, MotionSettings, cut_stretch  # noqa: E402
from poseloom.training.prior.network import Estimate, NetworkShape, PriorGru, split, widened  # noqa: E402
from poseloom.training.prior.people import LEFT_OUT, Role, person_sources, person_weights, role_of  # noqa: E402
from poseloom.training.prior.scene import Scene, make_scene, sizes_of  # noqa: E402
from poseloom.training.prior.sensor_errors import SensorErrors  # noqa: E402
from poseloom.training.prior.sets import NAMED_SETS, SIX_IMUS, draw_masks, draw_set, fixed_masks  # noqa: E402
from poseloom.training.prior.shards import Shard, build_shards, read_shard  # noqa: E402
from poseloom.training.prior.virtual_sensors import Batch, measure  # noqa: E402

DATA = os.environ.get("POSELOOM_DATA", "")
NO_ERRORS = SensorErrors(scales=(0.0, 0.0), dropout=0.0, calibrated=0.0, bend_gain=0.0, bend=0.0)
STILL = MotionSettings(frames=40, mirrored=0.0, slowest=1.0, fastest=1.0, arms=0.0, joint_rad=0.0, turned=0.0)
TINY = PriorSettings(shape=NetworkShape(8, 2), motions=replace(STILL, mirrored=0.5), size=2, steps=4, warm=2)


def made_shard(person: str = "cmu01", frames: int = 120, seed: int = 0) -> Shard:
    """A person who sways smoothly with every joint while walking along."""
    generator = np.random.default_rng(seed)
    body = average_body()
    time = np.arange(frames)[:, None] / RATE
    q = np.zeros((frames, body.size))
    for _ in range(3):
        q += (
            generator.normal(size=body.size)
            * 0.15
            * np.sin(2 * math.pi * generator.uniform(0.2, 1.0) * time + generator.uniform(0, 6))
        )
    q[:, 1] += 0.95
    q[:, 2] += 1.2 * time[:, 0]
    contacts = (generator.random((frames, 4)) < 0.5).astype(np.float32)
    half = frames // 2
    return Shard(person, q.astype(np.float32), contacts, np.array([[0, half], [half, frames]]), ("a", "b"))


def motions_of(shard: Shard, frames: int = 40) -> Motions:
    q = torch.from_numpy(shard.q[: frames + LEAD + 1].copy())[None]
    return Motions(
        q[..., 3:].reshape(1, len(q[0]), -1, 3), q[..., :3], torch.ones(1, len(q[0]), 4), torch.ones(1, len(q[0]))
    )


# ---- people --------------------------------------------------------------------------------------------------------


def test_nobody_who_is_left_out_trains() -> None:
    assert {person for person, role in LEFT_OUT.items() if role is Role.TEST} == {"cmu02", "cmu13", "cmu35", "hdm05:bd"}
    assert role_of("cmu14") is role_of("hdm05:mm") is Role.VALIDATE
    assert role_of("cmu29") is Role.TRAIN
    assert role_of("hdm05:bk") is Role.UNUSED
    for person in (*LEFT_OUT, "hdm05:bk", "bandai1", "cmu_expmap:walking", "deepmimic"):
        with pytest.raises(PoseloomError, match="would be trained on"):
            MotionPool([made_shard(person)])


def test_people_are_balanced_by_the_root_of_their_frames() -> None:
    shares = person_weights({"cmu05": 100, "cmu06": 400, "cmu29": 400})
    assert shares.sum() == pytest.approx(1.0)
    assert shares[1] == pytest.approx(2 * shares[0])
    assert shares[2] == pytest.approx(0.5 * shares[1])


@pytest.mark.recordings
@pytest.mark.skipif(not DATA, reason="POSELOOM_DATA names no folder of recordings")
def test_recordings_are_of_the_people_they_say_and_each_trial_is_there_once() -> None:
    people = person_sources(Path(DATA))
    assert {"cmu02", "cmu13", "cmu35", "hdm05:bd", "cmu14", "hdm05:mm", "cmu29"} <= set(people)
    trained = {Path(s.name).stem for person in people for s in people[person] if role_of(person) is Role.TRAIN}
    assert not {stem for stem in trained if stem.partition("_")[0] in ("02", "13", "35", "14")}
    for sources in people.values():
        stems = [Path(source.name).stem for source in sources]
        assert len(stems) == len(set(stems))


@pytest.mark.recordings
@pytest.mark.skipif(not DATA, reason="POSELOOM_DATA names no folder of recordings")
def test_shards_are_made_once_and_are_the_same_bytes(tmp_path: Path) -> None:
    (path,) = build_shards(Path(DATA), tmp_path / "a", ["cmu11"])
    (again,) = build_shards(Path(DATA), tmp_path / "b", ["cmu11"])
    assert path.read_bytes() == again.read_bytes()
    before = path.stat().st_mtime_ns
    build_shards(Path(DATA), tmp_path / "a", ["cmu11"])
    assert path.stat().st_mtime_ns == before
    shard = read_shard(path)
    assert shard.person == "cmu11"
    lowest = motion_frames(shard.clip(0)).positions[..., 1].min(axis=1)
    assert 0.0 < np.median(lowest) < 0.06


# ---- kinematics ----------------------------------------------------------------------------------------------------


def test_tensors_move_the_body_as_arrays_do() -> None:
    shard = made_shard()
    frames = motion_frames(make_motion(average_body(), shard.q.astype(np.float64), RATE))
    q = torch.from_numpy(shard.q.copy())
    rotations = global_rotations(matrix_from_rotvec(q[:, 3:].reshape(len(q), -1, 3)))
    places = q[:, None, :3] + joint_offsets(rotations, torch.from_numpy(average_body().offsets.astype(np.float32)))
    np.testing.assert_allclose(rotations.numpy(), frames.rotations, atol=2e-6)
    np.testing.assert_allclose(places.numpy(), frames.positions, atol=2e-6)


def test_rotations_of_tensors_agree_with_those_of_arrays() -> None:
    rotvec = torch.from_numpy(np.random.default_rng(0).normal(size=(50, 3)))
    matrix = matrix_from_rotvec(rotvec)
    np.testing.assert_allclose(
        kinematics.rotvec_from_matrix(matrix).numpy(), rotvec_from_matrix(matrix.numpy()), atol=1e-6
    )
    columns = torch.cat([matrix[..., 0], matrix[..., 1]], -1)
    np.testing.assert_allclose(matrix_from_columns(3 * columns).numpy(), matrix.numpy(), atol=1e-7)


def test_a_mirror_image_is_the_librarys() -> None:
    shard = made_shard()
    q = torch.from_numpy(shard.q.copy())
    rotvecs, root = mirror(q[:, 3:].reshape(len(q), -1, 3), q[:, :3])
    expected = mirror_pose_vectors(shard.q.astype(np.float64))
    np.testing.assert_allclose(rotvecs.reshape(len(q), -1).numpy(), expected[:, 3:], atol=1e-6)
    np.testing.assert_allclose(root.numpy(), expected[:, :3], atol=1e-6)


def test_stretches_between_frames_and_past_the_end() -> None:
    shard = made_shard()
    q, _, inside = cut_stretch(shard.q, shard.contacts, np.array([0.0, 10.5, 119.0, 130.0]))
    np.testing.assert_allclose(q[1], 0.5 * (shard.q[10] + shard.q[11]), atol=1e-6)
    np.testing.assert_allclose(q[3], shard.q[-1])
    np.testing.assert_array_equal(inside, [1, 1, 1, 0])


def test_feet_stay_where_they_stand_on_other_bodies() -> None:
    motions = motions_of(made_shard())
    usual = make_scene(motions, STILL, np.random.default_rng(0), size_scale=0.0)
    other = make_scene(motions, replace(STILL, joint_rad=0.1, turned=1.0), np.random.default_rng(3))
    feet = [BODY_BONES.index(name) for name in ("leftFoot", "leftToes", "rightFoot", "rightToes")]
    then, now = (scene.positions[:, :, feet].mean(2).diff(dim=1) for scene in (usual, other))
    np.testing.assert_allclose(now.numpy(), then.numpy(), atol=2e-3)
    assert (other.positions - usual.positions).abs().max() > 0.02
    tall = average_body().with_offsets(other.offsets[0].numpy().astype(np.float64))
    np.testing.assert_allclose(sizes_of(other.offsets)[0].numpy(), body_sizes(tall), atol=1e-4)


# ---- virtual sensors -----------------------------------------------------------------------------------------------


def samples_of(scene: Scene, bones: tuple[str, ...], positions: bool) -> list[Sample]:
    """What perfect sensors at the usual spots would give, from the scene's own frames."""
    layout = make_layout("all", [SensorSpec(bone, SensorKind.IMU, bone) for bone in bones], RATE)
    spots = [placement.p_bone_sensor for placement in default_placements(layout, average_body())]
    indices = [BODY_BONES.index(bone) for bone in bones]
    axes = scene.rotations[0, :, indices].numpy().astype(np.float64)
    places = scene.positions[0, :, indices].numpy() + np.einsum("tsij,sj->tsi", axes, np.stack(spots))
    felt = np.zeros_like(places)
    felt[1:-1] = (places[2:] - 2 * places[1:-1] + places[:-2]) * RATE**2 + [0.0, 9.80665, 0.0]
    turning = np.zeros_like(places)
    steps = rotvec_from_matrix(axes[1:] @ axes[:-1].swapaxes(-1, -2)) * RATE
    # Rates whose mean over each step is that step's.
    turning[0] = steps[0]
    for i in range(1, len(steps) + 1):
        turning[i] = 2 * steps[i - 1] - turning[i - 1]
    samples = []
    for i in range(len(places)):
        back = axes[i].swapaxes(-1, -2)
        samples.append(
            Sample(
                i / RATE, i / RATE, places[i] if positions else np.full_like(places[i], np.nan),
                quat_from_matrix(axes[i]),
                np.einsum("sij,sj->si", back, felt[i]), np.einsum("sij,sj->si", back, turning[i]),
                np.full(len(bones), np.nan), np.zeros(len(bones), dtype=np.int64),
            )
        )  # fmt: skip
    return samples


@pytest.mark.parametrize("spec", [SIX, ANY])
def test_virtual_sensors_give_what_samples_of_perfect_sensors_give(spec) -> None:
    shard = made_shard()
    scene = make_scene(motions_of(shard), STILL, np.random.default_rng(0), size_scale=0.0)
    scene = replace(scene, offsets=torch.from_numpy(average_body().offsets.astype(np.float32))[None])
    worn = dict.fromkeys(SIX_BONES, frozenset({Channel.ROTATION, Channel.ACCELERATION}))
    if spec is ANY:
        worn = {bone: kinds | {Channel.ANGULAR_RATE, Channel.POSITION} for bone, kinds in worn.items()}
    batch = measure(scene, fixed_masks(1, worn), spec, NO_ERRORS, np.random.default_rng(1))
    body = average_body()
    layout = make_layout("six", [SensorSpec(bone, SensorKind.IMU, bone) for bone in SIX_BONES], RATE)
    intake = PriorIntake(spec, layout, body, default_placements(layout, body))
    state = intake.start()
    for frame, sample in enumerate(samples_of(scene, SIX_BONES, spec is ANY)[:-1]):
        state, taken = intake.take(state, sample)
        if frame >= LEAD:
            told = batch.inputs[0, frame - LEAD].numpy()
            np.testing.assert_allclose(taken.inputs, told, atol=2e-2)  # accelerations of single-precision places
            np.testing.assert_allclose(
                np.delete(taken.inputs, _accelerations(spec)), np.delete(told, _accelerations(spec)), atol=3e-3
            )
            np.testing.assert_allclose(taken.base, batch.base[0, frame - LEAD].numpy(), atol=1e-4)


def _accelerations(spec) -> list[int]:
    sizes = {Channel.ROTATION: 7, Channel.ACCELERATION: 4, Channel.ANGULAR_RATE: 4, Channel.POSITION: 4,
             Channel.BEND: 2, Channel.RESIDUAL: 4}  # fmt: skip
    each = sum(sizes[channel] for channel in spec.channels) + 1
    return [row * each + 7 + k for row in range(len(spec.bones)) for k in range(3)]


def test_targets_are_the_bones_in_the_references_axes() -> None:
    scene = make_scene(motions_of(made_shard()), STILL, np.random.default_rng(0), size_scale=0.0)
    batch = measure(scene, fixed_masks(1, SIX_IMUS), SIX, NO_ERRORS, np.random.default_rng(1))
    now = slice(LEAD, LEAD + 40)
    world = batch.frame[:, :, None] @ batch.rotations
    np.testing.assert_allclose(world.numpy(), scene.rotations[:, now].numpy(), atol=1e-5)
    np.testing.assert_allclose(batch.rotations[:, :, 0].numpy(), np.broadcast_to(np.eye(3), (1, 40, 3, 3)), atol=1e-5)
    speed = (batch.frame @ batch.velocity[..., None])[..., 0]
    steps = scene.positions[:, now, 0] - scene.positions[:, LEAD - 1 : LEAD + 39, 0]
    np.testing.assert_allclose(speed.numpy(), RATE * steps.numpy(), atol=1e-4)


def test_errors_are_as_large_as_they_say() -> None:
    scene = make_scene(motions_of(made_shard()), STILL, np.random.default_rng(0))
    many = Scene(*(getattr(scene, name).expand(200, *getattr(scene, name).shape[1:]) for name in
                   ("rotations", "positions", "offsets", "contacts", "weights")))  # fmt: skip
    errors = replace(Conditions(scale=1.1).errors(), dropout=0.0)
    batch = measure(many, fixed_masks(200, SIX_IMUS), SIX, errors, np.random.default_rng(2))
    mean = math.degrees(float(batch.errors.mean()))
    assert 7.0 < mean < 9.0
    perfect = measure(many, fixed_masks(200, SIX_IMUS), SIX, NO_ERRORS, np.random.default_rng(2))
    assert float(perfect.errors.abs().max()) < 1e-3


def test_alignment_in_the_pose_leaves_no_residual_and_showing_it_does() -> None:
    scene = make_scene(motions_of(made_shard()), STILL, np.random.default_rng(0))
    for found in (True, False):
        conditions = Conditions(calibrated=True, taken_out=found)
        batch = measure(scene, fixed_masks(1, SIX_IMUS), SIX, conditions.errors(), np.random.default_rng(4))
        residuals = batch.inputs[0, 0, : 16 * 6].reshape(6, 16)[:, 11:15]
        np.testing.assert_array_equal(residuals[:, 3], 1.0)
        assert (residuals[:, :3].abs().max() < 1e-3) == found
        pose = batch.inputs[0, 0, -3:]
        assert pose[CalibrationPose.NONE] == 0
        assert pose.sum() == 1


def test_missing_samples_are_masked_and_the_base_holds() -> None:
    scene = make_scene(motions_of(made_shard()), STILL, np.random.default_rng(0))
    batch = measure(scene, fixed_masks(1, SIX_IMUS), SIX, replace(NO_ERRORS, dropout=1.0), np.random.default_rng(5))
    masks = batch.inputs[0, :, : 16 * 6].reshape(-1, 6, 16)[:, :, 6]
    assert 0 < masks.mean() < 1
    numbers = batch.inputs[0, :, : 16 * 6].reshape(-1, 6, 16)[:, :, :6]
    assert numbers[masks == 0].abs().max() == 0
    world = batch.frame[0, :, None] @ batch.base[0]
    head, measured = BODY_BONES.index("head"), masks[:, 1] > 0
    gone = torch.nonzero(~measured).flatten()
    if len(gone) and gone[0] > 0:
        np.testing.assert_allclose(world[gone[0], head].numpy(), world[gone[0] - 1, head].numpy(), atol=1e-5)


def test_sets_are_drawn_of_known_bones_and_all_channels() -> None:
    generator = np.random.default_rng(0)
    drawn = [draw_set(generator) for _ in range(400)]
    assert all(worn and set(worn) <= set(BODY_BONES) for worn in drawn)
    used = {channel for worn in drawn for kinds in worn.values() for channel in kinds}
    assert used == set(Channel) - {Channel.RESIDUAL}
    masks = draw_masks(8, generator)
    assert masks.measured.shape == (8, 22, len(Channel))
    owned = {"six-imus", "six-trackers", "three-trackers", "flex-four", "wrist-pocket", "pelvis-wrists"}
    assert owned | {f"slimevr-{n}" for n in (5, 6, 7, 8, 10)} <= set(NAMED_SETS)


@pytest.mark.parametrize("kind", ["six", "any"])
def test_batches_are_finite_and_repeat(kind: str) -> None:
    pool = MotionPool([made_shard(), made_shard("cmu05", seed=1)])
    settings = replace(TINY, kind=kind, size=6)
    first, again = (draw_batch(pool, settings, np.random.default_rng([3, 7])) for _ in range(2))
    assert torch.isfinite(first.inputs).all()
    assert torch.equal(first.inputs, again.inputs)
    assert torch.equal(first.rotations, again.rotations)


# ---- losses --------------------------------------------------------------------------------------------------------


def estimate_and_batch(seed: int) -> tuple[torch.Tensor, Batch]:
    pool = MotionPool([made_shard()])
    batch = draw_batch(pool, replace(TINY, motions=replace(STILL, frames=6)), np.random.default_rng(seed))
    batch = replace(batch, **{name: value.double() for name, value in vars(batch).items() if value.is_floating_point()})
    raw = torch.from_numpy(np.random.default_rng(seed).normal(size=(2, 6, 161)) * 0.3)
    raw[..., :132] += torch.tensor([1.0, 0, 0, 0, 1.0, 0]).repeat(22)
    return raw, batch


@pytest.mark.parametrize("name", list(vars(LossWeights())))
def test_gradients_of_losses_are_the_finite_differences(name: str) -> None:
    raw, batch = estimate_and_batch(1)
    only = replace(LossWeights(**dict.fromkeys(vars(LossWeights()), 0.0)), **{name: 1.0})

    def cost(numbers: torch.Tensor) -> torch.Tensor:
        return total_loss(loss_parts(split(numbers, batch.base), batch), only)

    leaf = raw.clone().requires_grad_()
    cost(leaf).backward()
    generator = np.random.default_rng(2)
    moves: list[torch.Tensor] = []
    for _ in range(4):
        way = torch.from_numpy(generator.normal(size=raw.shape))
        if name == "likelihood":
            way[..., :132] = 0.0  # it teaches the doubt only
        moves.append(way)
    for way in moves:
        step = 1e-6
        numeric = float(cost(raw + step * way) - cost(raw - step * way)) / (2 * step)
        assert float((leaf.grad * way).sum()) == pytest.approx(numeric, rel=2e-4, abs=1e-8)
    assert leaf.grad.abs().max() > 0


def test_the_likelihood_moves_no_pose() -> None:
    raw, batch = estimate_and_batch(1)
    leaf = raw.clone().requires_grad_()
    loss_parts(split(leaf, batch.base), batch)["likelihood"].backward()
    assert float(leaf.grad[..., :132].abs().max()) == 0.0


def test_the_truth_costs_nothing_but_its_doubt() -> None:
    _, batch = estimate_and_batch(1)
    sure = Estimate(batch.rotations, torch.full((2, 6, 22), -4.0).double(), 60 * (batch.contacts - 0.5), batch.velocity)
    parts = loss_parts(sure, batch)
    assert all(float(parts[name]) < 0.011 for name in parts if name != "likelihood")


def test_sigma_is_learnt_as_the_size_of_errors() -> None:
    """The likelihood is least where sigma is the root mean square error an axis."""
    _, batch = estimate_and_batch(1)
    turn = matrix_from_rotvec(torch.from_numpy(np.random.default_rng(0).normal(size=(2, 6, 22, 3)) * 0.2))
    costs = {}
    for sigma in (0.1, 0.2, 0.4):
        off = Estimate(
            batch.rotations @ turn, torch.full((2, 6, 22), math.log(sigma)).double(), batch.contacts, batch.velocity
        )
        costs[sigma] = float(loss_parts(off, batch)["likelihood"])
    assert min(costs, key=costs.__getitem__) == 0.2


# ---- loop, judging, export -----------------------------------------------------------------------------------------


def test_a_killed_training_goes_on_as_if_unbroken(tmp_path: Path) -> None:
    pool = MotionPool([made_shard()])
    whole = train_prior(pool, TINY, lambda _: {}, 1, tmp_path / "whole.pt", every=2)

    def die(entry) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_prior(pool, TINY, lambda _: {}, 1, tmp_path / "part.pt", every=2, progress=die)
    resumed = train_prior(pool, TINY, lambda _: {}, 1, tmp_path / "part.pt", every=2)
    for name, value in whole.network.state_dict().items():
        assert torch.equal(value, resumed.network.state_dict()[name])
    assert [entry["step"] for entry in resumed.curve] == [2, 4]
    assert (tmp_path / "part.json").is_file()
    with pytest.raises(FormatError, match="other settings"):
        train_prior(pool, replace(TINY, rate=1e-4), lambda _: {}, 1, tmp_path / "part.pt")
    (tmp_path / "part.pt").write_bytes(b"no checkpoint")
    with pytest.raises(FormatError, match="cannot be read"):
        train_prior(pool, TINY, lambda _: {}, 1, tmp_path / "part.pt")


def test_the_rate_rises_stays_and_falls() -> None:
    settings = PriorSettings(steps=1000, warm=100, tail=0.5, rate=1.0)
    assert rate_at(0, settings) == pytest.approx(0.01)
    assert rate_at(400, settings) == 1.0
    assert rate_at(750, settings) == pytest.approx(0.5)
    assert rate_at(1000, settings) == pytest.approx(0.0)
    assert rate_at(10**6, PriorSettings(steps=10**7, tail=0.0, rate=1.0)) == 1.0


@pytest.mark.parametrize("spec", [SIX, ANY])
def test_numpy_steps_as_torch_does(spec) -> None:
    torch.manual_seed(3)
    network = PriorGru(spec, NetworkShape(32, 2))
    with torch.no_grad():
        network.head.weight.mul_(10.0)
    generator = np.random.default_rng(0)
    inputs = generator.normal(size=(1, 50, spec.size)).astype(np.float32)
    base = matrix_from_rotvec(torch.from_numpy(generator.normal(size=(1, 50, 22, 3)).astype(np.float32)))
    with torch.no_grad():
        told = split(network(torch.from_numpy(inputs)), base)
    plain = PriorNetwork(spec, weights_of(network))
    memory = plain.start()
    for frame in range(50):
        memory, estimate = plain.step(
            memory, inputs[0, frame].astype(np.float64), base[0, frame].numpy().astype(np.float64)
        )
        np.testing.assert_allclose(estimate.rotations, told.rotations[0, frame].numpy(), atol=1e-5)
        np.testing.assert_allclose(estimate.sigma, told.log_sigma[0, frame].exp().numpy(), atol=1e-5)
        np.testing.assert_allclose(estimate.contacts, torch.sigmoid(told.contacts[0, frame]).numpy(), atol=1e-5)
        np.testing.assert_allclose(estimate.velocity, told.velocity[0, frame].numpy(), atol=1e-5)


def test_a_widened_network_says_the_same_of_what_both_receive() -> None:
    torch.manual_seed(2)
    small, large = PriorGru(SIX, NetworkShape(16, 2)), PriorGru(ANY, NetworkShape(16, 2))
    large.load_state_dict(widened(small.state_dict(), SIX, ANY, seed=0))
    pool = MotionPool([made_shard()])
    narrow = draw_batch(pool, TINY, np.random.default_rng(5)).inputs
    wide = torch.zeros(*narrow.shape[:2], ANY.size)
    at = 0
    for bone in SIX.bones:
        begin = BODY_BONES.index(bone) * (ANY.size - 14) // 22
        for size, offset in ((7, 0), (4, 7), (4, 21), (1, 25)):  # rotation, acceleration, residual, reference
            wide[..., begin + offset : begin + offset + size] = narrow[..., at : at + size]
            at += size
    wide[..., -14:] = narrow[..., -14:]
    with torch.no_grad():
        np.testing.assert_allclose(large(wide).numpy(), small(narrow).numpy(), atol=1e-5)


def test_judging_repeats_and_correction_takes_half_of_the_error() -> None:
    torch.manual_seed(1)
    network = PriorGru(SIX, NetworkShape(8, 2)).eval()
    shard = made_shard("cmu14", frames=400)
    batch = judging_batch(shard, SIX, SIX_IMUS, Conditions(calibrated=True), most=2)
    again = judging_batch(shard, SIX, SIX_IMUS, Conditions(calibrated=True), most=2)
    assert torch.equal(batch.inputs, again.inputs)
    plain, halved = judge(network, batch), judge(network, batch, 0.5)
    assert plain != halved
    assert 0 <= plain["within_1_sigma"] <= plain["within_2_sigma"] <= 1
    factors = sigma_factors(network, [batch])
    assert factors.shape == (22,)
    assert (factors > 0).all()
    assert {share for _, share in CONDITIONS.values()} == {0.0, 0.5}


def test_an_exported_prior_says_who_it_learnt_from(tmp_path: Path) -> None:
    torch.manual_seed(1)
    network = PriorGru(SIX, NetworkShape(8, 2)).eval()
    shards = [made_shard("cmu05"), made_shard("cmu14", 300), made_shard("cmu02", 300), made_shard("hdm05:mm", 300)]
    export_prior(network, "six", shards, tmp_path / "six.npz", 7, ({"step": 4.0, "seconds": 36.0},))
    back = read_prior(tmp_path / "six.npz")
    assert list(back.card["people"]) == ["cmu05"]
    assert set(back.card["validation"]["six-imus"]) == {"cmu14", "hdm05:mm"}
    assert back.card["training"] == {"steps": 4, "hours": 0.01}
