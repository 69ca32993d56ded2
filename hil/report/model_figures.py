"""Figures of what a model has learned: its latent spaces, its trajectories, its styles and its training."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap

from highfive.hil.evaluation.cross_validation import Run
from highfive.hil.evaluation.style_mixtures import Morph
from highfive.hil.report.colours import PERSON, blend_of, colour_of, mark_of
from highfive.hil.report.drawing import FAINT, HINGES, INK, Drawing, new_figure
from highfive.hil.runtime.console import counted
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.model.evaluation import scores as evaluation
from highfive.model.geometry.rotations import Array
from highfive.model.gp import sparse
from highfive.model.hgpdm.dataset import hand_history
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.responder import Responder, Response

INSIDE_90 = 1.645  # standard deviations either side that hold 90 % of a Gaussian
_CLOUD_RATE = 15.0  # Hz, of the points in the latent spaces
_CLOUD_TRIALS = 72
_PHASE = 0.8  # s from contact at which the colours of the phase end
_PHASE_COLOURS = ListedColormap(colormaps["viridis"](np.linspace(0.88, 0.0, 256)))  # without its yellow, faint on white
_COLUMNS = 4  # emotions beside each other
_ANGLES = (0, 3, 4)  # of HINGES
_FINGERS = tuple(f"{s}_{f}" for s in ("left", "right") for f in ("thumb", "index", "middle", "ring", "little"))


def latent_spaces(model: HGPDM, trials: Sequence[Trial]) -> Drawing:
    """The three latent spaces at the hands of trials, by time to contact and by emotion."""
    known = [trial for trial in trials if trial.emotion in model.emotions]
    shown = known[:: max(1, -(-len(known) // _CLOUD_TRIALS))]
    times = [np.arange(0.0, len(t.joints) / t.rate_hz, 1.0 / _CLOUD_RATE) for t in shown]
    history = [hand_history(t, at, model.preset.history) for t, at in zip(shown, times, strict=True)]
    projected, dims = model.back_project(np.concatenate(history)), model.preset.interaction_dims
    interaction = projected[:, :dims]
    below = np.asarray(sparse.means(model.interaction, jnp.asarray(interaction)))
    split = model.preset.avatar_dims
    # X¹ as it is used: from the hand where it is projected back, else from I like X².
    avatar = projected[:, dims:] if projected.shape[1] > dims else below[:, :split]
    spaces = {"interaction, I": interaction, "avatar, X¹": avatar, "person's hand, X²": below[:, split:]}
    phase = np.concatenate([t.contact_frame / t.rate_hz - at for t, at in zip(shown, times, strict=True)])
    emotion = np.repeat([model.emotions.index(t.emotion) for t in shown], [len(at) for at in times])
    figure = new_figure(9.0, 6.0)
    rows = figure.subplots(2, 3)
    cloud = None
    for (upper, lower), (name, values) in zip(rows.T, spaces.items(), strict=True):
        points, shares = _principal(values)
        order = np.argsort(-np.abs(phase))  # contact on top
        cloud = upper.scatter(
            *points[order].T, c=phase[order], cmap=_PHASE_COLOURS, vmin=-_PHASE, vmax=_PHASE, s=5, lw=0, rasterized=True
        )
        for number, label in enumerate(model.emotions):
            mine = points[emotion == number]
            lower.scatter(
                *mine.T, color=colour_of(label), marker=mark_of(label), s=6, lw=0, alpha=0.55, rasterized=True
            )
        upper.set_title(name)
        for axes in (upper, lower):
            axes.set_xlabel(f"axis 1 ({100 * shares[0]:.0f} %)")
            axes.set_ylabel(f"axis 2 ({100 * shares[1]:.0f} %)")
            axes.set_xticks([])
            axes.set_yticks([])
    assert cloud is not None
    bar = figure.colorbar(cloud, ax=rows[0], pad=0.01, extend="both", label="time to contact, s")
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    handles = [
        rows[1, 2].plot([], [], mark_of(label), color=colour_of(label), ms=6, label=label)[0]
        for label in model.emotions
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=9)
    caption = (
        f"Latent spaces at the hands of {counted(len(shown), 'trial')}, fifteen points per second, along the two axes "
        "along which they vary most, with their share of the variance. Above by time to contact (negative: after it), "
        "below by emotion: they are reached from the hand alone, so emotions part only as far as people raise it "
        "differently."
    )
    return Drawing("latent_spaces", caption, figure)


def _principal(values: Array) -> tuple[Array, Array]:
    """The two principal axes (N, 2) of points (N, q), and their shares of the variance."""
    centred = values - values.mean(axis=0)
    if centred.shape[1] < 2:
        centred = np.column_stack([centred, np.zeros(len(centred))])
    _, singular, axes = np.linalg.svd(centred, full_matrices=False)
    return centred @ axes[:2].T, np.square(singular[:2]) / max(float(np.sum(np.square(singular))), 1e-12)


def trajectories(run: Run) -> Drawing:
    """Generated and recorded palm and arm angles with 90 % bands: one held-out trial an emotion."""
    model, chosen = run.fitted.model, _typical(run)
    figure = new_figure(2.0 + 1.9 * len(chosen), 8.2)
    rows = figure.subplots(3 + len(_ANGLES), len(chosen), squeeze=False, sharex="col", sharey="row")
    for column, trial in zip(rows.T, chosen, strict=True):
        responder, responses, angles = Responder(model, trial.emotion, trial.rate_hz), [], []
        for hand in trial.hand_points:
            responses.append(response := responder.step(hand))
            angles.append([_angle(response, number) for number in _ANGLES])
        time = (np.arange(len(trial.joints)) - trial.contact_frame) / trial.rate_hz
        part = (time >= -1.2) & (time <= 1.2)
        palm, spread = np.array([r.palm for r in responses]), np.array([r.palm_std for r in responses])
        table, colour = np.array(angles), colour_of(trial.emotion)
        for place, axes in enumerate(column[:3]):
            _band(axes, time[part], palm[part, place], spread[part, place], trial.palm[part, place], colour)
        for place, axes in enumerate(column[3:]):
            recorded = np.array([_recorded_angle(trial.joints[f], _ANGLES[place]) for f in np.flatnonzero(part)])
            _band(axes, time[part], table[part, place, 0], table[part, place, 1], recorded, colour)
        column[0].set_title(f"{trial.emotion}{trial.cell and ', cell ' + trial.cell}", color=colour)
        column[-1].set_xlabel("s from contact")
    several = len(chosen) == 3 and len(run.fitted.emotions) == 1
    names = ["palm x, m", "palm y, m", "palm z, m", *(HINGES[n][2] + ", °" for n in _ANGLES)]
    for axes, name in zip(rows[:, 0], names, strict=True):
        axes.set_ylabel(name)
    caption = (
        "Palm and joint angles of the avatar's right arm, before any correction: in colour as generated, with the "
        "interval that is to hold 90 %, dark and dashed as recorded. For each emotion the held-out trial with the "
        f"median error at contact{'; left and right of it those with the quartiles' if several else ''}."
    )
    return Drawing("trajectories", caption, figure)


def _typical(run: Run) -> list[Trial]:
    """Held-out trials of the first fold: the one with the median error at contact for each emotion; of one, three."""
    errors = evaluation.contact_errors(run.trials, run.answers["hgpdm"])
    emotions = run.fitted.emotions[:_COLUMNS]
    quantiles = (0.25, 0.5, 0.75) if len(emotions) == 1 else (0.5,)
    chosen = []
    for emotion in emotions:
        mine = [i for i, t in enumerate(run.trials) if t.emotion == emotion and run.folds[i] == run.folds[0]]
        mine.sort(key=lambda i: errors[i])
        chosen += [run.trials[i] for i in dict.fromkeys(mine[int(q * (len(mine) - 1))] for q in quantiles if mine)]
    return chosen


def _band(axes: Axes, time: Array, mean: Array, deviation: Array, recorded: Array, colour: str) -> None:
    axes.fill_between(
        time,
        mean - INSIDE_90 * deviation,
        mean + INSIDE_90 * deviation,
        color=colour,
        alpha=0.25,
        lw=0,
        rasterized=False,
    )
    axes.plot(time, recorded, color=INK, lw=1.0, ls=(0, (4, 1.5)))
    axes.plot(time, mean, color=colour, lw=1.6)
    axes.axvline(0.0, color=FAINT, lw=0.8)


def _angle(response: Response, number: int) -> tuple[float, float]:
    """A hinge angle and its standard deviation, °, linearised about the generated pose."""
    index = avatar_skeleton().index(HINGES[number][0])
    part = slice(3 * index, 3 * index + 3)
    here, step = _recorded_angle(response.joints, number), 1e-4
    slope = np.zeros(3)
    for axis in range(3):
        moved = response.joints.copy()
        moved[part.start + axis] += step
        slope[axis] = (_recorded_angle(moved, number) - here) / step
    return here, float(np.sqrt(slope @ response.generated.covariance(part) @ slope))


def _recorded_angle(joints: Array, number: int) -> float:
    """A hinge angle, °, of a pose's rotation vectors (D,)."""
    skeleton = avatar_skeleton()
    joint, hinge, _, sign = HINGES[number]
    return sign * float(
        np.degrees(skeleton.to_hinges(skeleton.from_rotation_vectors(joints))[skeleton.index(joint), hinge])
    )


def style_strips(morphs: Sequence[Morph]) -> Drawing | None:
    """Stick figures at moments of one reach, a mixture of two styles each row."""
    if not morphs:
        return None
    columns = len(morphs[0].moments)
    figure = new_figure(9.0, 1.95 * len(morphs) + 0.3)
    grid = figure.subplots(len(morphs), columns, squeeze=False, sharex=True, sharey=True)
    for number, (row, morph) in enumerate(zip(grid, morphs, strict=True)):
        for axes, moment, joints, hand in zip(row, morph.moments, morph.joints, morph.hands, strict=True):
            _stick_figure(axes, joints, hand, blend_of(morph.start, morph.end, morph.weight))
            if number == 0:
                axes.set_title(
                    f"{moment:+.1f} s".replace("-", "−") if moment else "contact", fontsize=10, fontweight="normal"
                )
        row[0].set_ylabel(
            f"{morph.label}\npeak {morph.peak_speed:.2f} m/s", rotation=0, ha="right", va="center", fontsize=9
        )
    first = morphs[0]
    caption = (
        f"One hand ({first.source}), answered in mixtures of two styles, before any correction; from the side, the "
        "avatar looks to the right. Thick: the right arm; violet: the person's wrist and hand. Beside each row: the "
        "highest speed of the avatar's palm until contact."
    )
    return Drawing("style_strips", caption, figure)


def _stick_figure(axes: Axes, joints: Array, hand: Array, colour: str) -> None:
    skeleton = avatar_skeleton()
    for joint, parent in enumerate(skeleton.parents):
        name = skeleton.names[joint]
        if parent < 0 or (name.startswith(_FINGERS) and "middle" not in name):
            continue  # of the fingers one is enough
        arm = name.startswith("right_") and any(p in name for p in ("shoulder", "elbow", "wrist", "middle"))
        left = name.startswith("left_")
        axes.plot(
            joints[[parent, joint], 0], joints[[parent, joint], 2], color=colour if arm else FAINT if left else INK,
            lw=2.6 if arm else 1.0 if left else 1.5, solid_capstyle="round", zorder=3 if arm else 1 if left else 2,
        )  # fmt: skip
    head = skeleton.names.index("head") if "head" in skeleton.names else None
    if head is not None:
        axes.plot(joints[head, 0], joints[head, 2] + 0.1, "o", ms=9, mfc="none", mec=INK, mew=1.3)
    axes.plot(hand[:, 0], hand[:, 2], color=PERSON, lw=2.6, solid_capstyle="round", zorder=4)
    axes.plot(hand[0, 0], hand[0, 2], "o", color=PERSON, ms=5, zorder=4)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_visible(False)


def learning_curve(model: HGPDM) -> Drawing | None:
    """The objective over the steps of the training, above where it ended."""
    curve = np.asarray(model.learning_curve, dtype=float)
    if len(curve) < 3:
        return None
    above = curve - curve.min()
    figure = new_figure(9.0, 2.7)
    axes = figure.subplots()
    steps = np.arange(1, len(curve) + 1)
    axes.plot(steps, np.where(above > 0.0, above, np.nan), color=colour_of("sad"), lw=1.6)
    axes.set_yscale("log")
    axes.set_xlim(0, len(curve))
    bound = 1e-3 * abs(curve.min())
    axes.axhline(bound, color=FAINT, lw=0.8, ls=(0, (4, 3)))
    axes.annotate("0.1 %", (1.0, bound), xycoords=("axes fraction", "data"), va="center", color=FAINT, fontsize=9)
    axes.set_xlabel("step")
    axes.set_ylabel("objective above its lowest,\nnats a training point")
    caption = (
        "Joint training: negative log density a training point, above the lowest that was reached "
        f"({curve.min():.2f}); dashed: a thousandth of it."
    )
    return Drawing("learning_curve", caption, figure)
