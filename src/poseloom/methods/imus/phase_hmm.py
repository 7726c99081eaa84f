"""The phase HMM with reactive interpolation: full-body motion from one to three IMUs, one sample at a time.

Source: Mousas, Full-body locomotion reconstruction of virtual characters using a single inertial measurement unit,
Sensors 2017. Sections and equations in the modules beside this one; `docs/phases-and-hmm.md` has the derivations and
where the default settings depart from the paper's (`PAPER_SETTINGS`).
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from poseloom.arrays import Array, Bools, Floats, Floats32, Ints
from poseloom.errors import MethodError
from poseloom.methods.contract import Frame, Health, HealthState, Reconstructor, check_wearer
from poseloom.methods.imus import _forward_kernels, _pose_kernels
from poseloom.methods.imus.echoes import Echoes, echo_search
from poseloom.methods.imus.fitting import bone_lengths, fit_model
from poseloom.methods.imus.ground import make_legs
from poseloom.methods.imus.model import WAY_ENTRIES, HmmModel
from poseloom.methods.imus.mounting import aligned, misaligned, observe_mounting, unknown_mounting
from poseloom.methods.imus.pairs import CHANNELS, SignalPair, check_imus, pairs_digest, sample_signal
from poseloom.methods.imus.placing import footing_of, in_place
from poseloom.methods.imus.settings import PhaseHmmSettings
from poseloom.methods.imus.state import Guess, PhaseHmmState, Wearer
from poseloom.methods.imus.strides import foot_sensors, no_stride, sensed
from poseloom.sensors import Placement, Sample, SensorLayout
from poseloom.skeleton.body import BODY_BONES
from poseloom.skeleton.motion import Pose
from poseloom.skeleton.retarget import leg_length
from poseloom.skeleton.skeleton import Skeleton

_WAY_SPREAD = 0.05
"""Standard deviation of the root's place, as a share of the way gone."""


class PhaseHmm(Reconstructor[PhaseHmmState]):
    """Full-body motion from one to three IMUs by a two-level HMM over the frames of examples.

    Fit one with `fit_phase_hmm`, read one with `read_phase_hmm`.

    Attributes:
        layout: The IMUs.
        model: What was learnt.
        settings: How it is run.
        seed: Of the fit.
        data_digest: Digest of the pairs it was fitted to.
    """

    def __init__(
        self, layout: SensorLayout, model: HmmModel, settings: PhaseHmmSettings, seed: int = 0, data_digest: str = ""
    ) -> None:
        check_imus(layout)
        if model.signals.shape[1] != CHANNELS * len(layout):
            raise MethodError(
                f"the model knows {model.signals.shape[1]} channels, the layout {layout.name!r} has "
                f"{CHANNELS * len(layout)}",
                remedy="Run the model on the layout it was fitted to",
            )
        self.layout = layout
        self.delay = 0
        self.model = model
        self.settings = settings
        self.seed = seed
        self.data_digest = data_digest
        self._precisions = [each.precision.astype(np.float32) for each in model.emissions]
        self._log_norms = [0.5 * np.log(each.precision / (2 * np.pi)).sum(axis=1) for each in model.emissions]
        self._steps = np.array(settings.steps)
        scales = model.emissions[-1].signal_features.scale.reshape(-1, 2, 3)
        self._sigmas = np.sqrt((scales**2).mean(axis=2))
        self._rejoin = max(round(settings.rejoin_seconds * layout.rate), 1)
        self._echoes = echo_search(model, float(np.exp(-1 / (settings.echo_seconds * layout.rate))), settings.echoes)
        self._footing = footing_of(settings, layout.rate)
        self._stride = -(-len(model) // settings.restart_states)

    def start(self, skeleton: Skeleton, placements: Sequence[Placement]) -> PhaseHmmState:
        """See `Reconstructor.start`. Placements must be the layout's usual ones up to a mounting error."""
        check_wearer("the phase HMM moves", self.layout, skeleton, placements)
        feet = foot_sensors(skeleton, placements) if self._footing.paid > 0 and self.settings.foot_odometer else ()
        weights, strangeness = self._body_weights(skeleton)
        wearer = Wearer(make_legs(skeleton), leg_length(skeleton), weights, strangeness, feet)
        quats = np.zeros((len(BODY_BONES), 4))
        quats[:, 0] = 1.0
        return PhaseHmmState(
            wearer,
            None,
            self._echoes.none(),
            np.full((self.model.window, CHANNELS * len(self.layout)), np.nan),
            unknown_mounting(len(self.layout), self.settings.mounting),
            None,
            quats,
            np.zeros(skeleton.size),
            None,
            tuple(no_stride() for _ in feet),
        )

    def step(self, state: PhaseHmmState, sample: Sample) -> tuple[PhaseHmmState, Frame | None]:
        """See `Reconstructor.step`. No frame comes until all sensors have spoken once."""
        said = sample_signal(sample)
        heard = np.asarray(np.isfinite(said).reshape(len(self.layout), -1).all(axis=1))
        if state.guess is None:
            if not heard.all():
                return state, None
            window = np.repeat(said[None], len(state.window), axis=0)
        else:
            expected = misaligned(state.mounting, state.guess.signal)
            said = np.where(np.repeat(heard, CHANNELS), said, expected)
            window = np.concatenate([state.window[1:], said[None]])
        spoken = bool(heard.any())
        live_window = aligned(state.mounting, window)
        age = min(state.age + 1, len(window))
        stage = self._stage(age)
        emission = self.model.emissions[stage].signal_features
        seen = emission.of_window(live_window[len(window) - emission.window :])
        log_alpha = self._forward(state, stage, seen if spoken else None)
        whole = spoken and stage == len(self.model.emissions) - 1
        echoes = self._echoes.heard(state.echoes, said)
        guess = self._guess(state, log_alpha, echoes, seen, self.settings.correction if whole else 0.0)
        mounting = state.mounting
        if spoken and self.settings.mounting > 0:
            mounting = observe_mounting(mounting, said, guess.signal, heard, self._sigmas, self.settings.mounting_gain)
        moved = replace(
            state,
            log_alpha=log_alpha,
            echoes=echoes,
            window=window,
            mounting=mounting,
            guess=guess,
            strides=tuple(
                sensed(stride, foot, said, heard, guess.others[WAY_ENTRIES:], guess.ups, 1 / self.layout.rate)
                for stride, foot in zip(state.strides, state.wearer.feet, strict=True)
            ),
            age=age,
            turn=(state.turn + 1) % self._stride,
            silent=0 if spoken else state.silent + 1,
            rejoining=max(state.rejoining - 1, 0) if spoken else self._rejoin,
        )
        live = live_window[-1] if spoken else guess.signal
        placed = in_place(state, moved, guess, live, self.settings, self._footing, self.layout.rate)
        return placed, Frame(sample.time, self._pose(placed), self._spread(placed), self._health(placed, heard))

    def phase_probabilities(self, state: PhaseHmmState) -> dict[str, float]:
        """The probability of each upper state, such as "walking: mid-stance"; empty before the first sample."""
        if state.log_alpha is None:
            return {}
        masses = np.bincount(self.model.phase_of_state, np.exp(state.log_alpha), minlength=len(self.model.phase_names))
        return {name: float(mass) for name, mass in zip(self.model.phase_names, masses, strict=True)}

    def _body_weights(self, skeleton: Skeleton) -> tuple[Floats[Array, "segments"], Floats32[Array, "segments"]]:
        """Of each segment the log weight for how well its build fits the wearer's, and its strangeness."""
        how, owner = self.settings, self.model.body_of_segment
        apart = self.model.bodies - bone_lengths(skeleton)
        away = np.linalg.norm(apart / how.body_scale, axis=1)
        strangeness = how.echo_build * np.square(100 * apart).mean(axis=1)
        return -0.5 * np.minimum(away, how.body_limit)[owner] ** 2, strangeness.astype(np.float32)[owner]

    def _stage(self, age: int) -> int:
        """Index of the longest window that so many samples fill; the shortest where they fill none."""
        fitting = [i for i, each in enumerate(self.model.emissions) if each.signal_features.window <= age]
        return fitting[-1] if fitting else 0

    def _forward(
        self, state: PhaseHmmState, stage: int, seen: Floats32[Array, "columns"] | None
    ) -> Floats[Array, "states"]:
        model, how = self.model, self.settings
        predicted = np.empty(len(model))
        if state.log_alpha is None:
            predicted[:] = 1 / len(model)
        else:
            _forward_kernels.predict(
                state.log_alpha, model.first, model.stop, model.phase_of_segment, model.successor, model.entry,
                model.phase_sizes, self._steps, how.continuity, predicted,
            )  # fmt: skip
        log_alpha = np.empty(len(model))
        if seen is None:
            _forward_kernels.settle(predicted, how.beam, log_alpha)
        else:
            _forward_kernels.update(
                predicted, model.emissions[stage].features, self._precisions[stage], self._log_norms[stage],
                state.wearer.log_weight, model.first, model.stop, model.phase_of_segment, seen, how.restart,
                self._stride, state.turn, how.beam, log_alpha,
            )  # fmt: skip
        return log_alpha

    def _guess(
        self, state: PhaseHmmState, log_alpha: Floats[Array, "states"], echoes: Echoes,
        seen: Floats32[Array, "columns"], correction: float,
    ) -> Guess:  # fmt: skip
        model = self.model
        best, best_weights, places = self._best(state, log_alpha)
        segments, weights = best, best_weights
        if self.settings.echoes > 0:
            rows, owners = self._echoes.nearest(echoes, state.wearer.strangeness)
            share = self.settings.echo_share
            segments, places = np.concatenate([best, owners]), np.concatenate([places, rows])
            weights = np.concatenate([(1 - share) * best_weights, np.full(len(rows), share / len(rows))])
        lower = np.floor(places).astype(np.int64)
        upper = np.minimum(lower + 1, model.stop[segments] - 1)
        fraction = np.where(upper > lower, places - lower, 0.0)
        others = self._between(model.others, lower, upper, fraction)
        joints = model.quats_wxyz.shape[1]
        mean, variance, speed = np.empty((joints, 4)), np.empty(3 * joints), np.empty(3 * joints)
        corrected = np.ascontiguousarray(others[:, :WAY_ENTRIES])
        _pose_kernels.interpolate(
            model.quats_wxyz, model.emissions[-1].features, model.maps, model.gains, model.variances, lower, upper,
            fraction, weights, seen, correction, mean, variance, speed, corrected,
        )  # fmt: skip
        others[:, :WAY_ENTRIES] = corrected
        return Guess(
            mean,
            variance,
            speed,
            weights @ others,
            weights @ self._between(model.signals, lower, upper, fraction),
            np.tensordot(weights, self._between(model.ups, lower, upper, fraction), 1),
            best,
            best_weights,
        )

    def _best(
        self, state: PhaseHmmState, log_alpha: Floats[Array, "states"]
    ) -> tuple[Ints[Array, "best"], Floats[Array, "best"], Floats[Array, "best"]]:
        """The K best segments, their weights, and the state at which one is in each."""
        model, how = self.model, self.settings
        chosen = np.empty(how.neighbours, dtype=np.int64)
        mass, place = np.empty(how.neighbours), np.empty(how.neighbours)
        allowed = np.ones(len(model.phase_names), dtype=np.bool_)
        if how.one_phase:
            masses = np.bincount(model.phase_of_state, np.exp(log_alpha), minlength=len(allowed))
            allowed = np.arange(len(allowed)) == int(np.argmax(masses))
        count = _forward_kernels.best_segments(
            log_alpha, model.first, model.stop, model.phase_of_segment, allowed, how.reach, chosen, mass, place
        )
        weights = np.empty(count)
        _forward_kernels.even_out(mass[:count], min(how.evenness, float(count)), weights)
        if state.guess is not None and how.weight_smoothing > 0:
            same = chosen[:count, None] == state.guess.segments[None]
            weights = (1 - how.weight_smoothing) * weights + how.weight_smoothing * (same @ state.guess.weights)
            weights /= weights.sum()
        return chosen[:count], weights, place[:count]

    @staticmethod
    def _between(
        values: Floats32[Array, "states *columns"],
        lower: Ints[Array, "best"],
        upper: Ints[Array, "best"],
        fraction: Floats[Array, "best"],
    ) -> Floats[Array, "best *columns"]:
        share = fraction.reshape(-1, *(1,) * (values.ndim - 1))
        return (1 - share) * values[lower] + share * values[upper]

    def _pose(self, state: PhaseHmmState) -> Pose:
        return Pose(state.wearer.legs.skeleton, state.q)

    def _spread(self, state: PhaseHmmState) -> Floats[Array, "dofs"]:
        assert state.guess is not None
        place = np.full(3, _WAY_SPREAD * state.gone + 0.01)
        return np.concatenate([place, np.sqrt(np.maximum(state.guess.variance, 1e-8))])

    def _health(self, state: PhaseHmmState, heard: Bools[Array, "sensors"]) -> Health:
        missing = tuple(name for name, spoke in zip(self.layout.names, heard, strict=True) if not spoke)
        if not missing:
            return Health()
        if heard.any():
            return Health(HealthState.DEGRADED, missing)
        lost = state.silent > self.settings.lost_after * self.layout.rate
        return Health(HealthState.LOST if lost else HealthState.COASTING, missing)


def fit_phase_hmm(
    pairs: Sequence[SignalPair],
    layout: SensorLayout,
    settings: PhaseHmmSettings | None = None,
    seed: int = 0,
    progress: Callable[[str, int, int], object] | None = None,
) -> PhaseHmm:
    """Fits the phase HMM to pairs of motion and signal, ready to run.

    Args:
        pairs: Of the layout, at its rate; see `library_pairs` and `pair_of_recording`.
        layout: One to three IMUs.
        settings: The tuned ones unless given; `PAPER_SETTINGS` for the paper's model.
        seed: Of what is drawn in fitting.
        progress: Told what is being done, and how many of how many are.

    Raises:
        MethodError: for no pairs, or pairs that do not fit the layout.
    """
    how = settings or PhaseHmmSettings()
    check_imus(layout)
    model = fit_model(pairs, layout, how, seed, progress)
    return PhaseHmm(layout, model, how, seed, pairs_digest(pairs))
