"""An experiment's trials in virtual time, from a person, or a live system, to the recording."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from helpers.experiments import head, protocol

from highfive.hil.arm.arm_trial import ArmWatch
from highfive.hil.arm.loop import ArmLoop
from highfive.hil.commands.arm_in_run import ArmInRun
from highfive.hil.commands.clips import Clip
from highfive.hil.commands.experiment_stage import AvatarStage
from highfive.hil.commands.tap_switch import TapSwitch
from highfive.hil.evaluation.reaction_models import open_model
from highfive.hil.experiments.desk import Desk
from highfive.hil.experiments.plan import PlannedTrial
from highfive.hil.experiments.stage import Asked
from highfive.hil.experiments.trial_row import TrialRow
from highfive.hil.publish.outputs import SessionOutputs
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.session.session import Session
from highfive.hil.session.shown import Shown
from highfive.hil.sim.people.capture import PERSON_SET
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.live_partner import LivePerson
from highfive.hil.trials.summary import SessionSettings
from highfive.hil.view.commands import Command
from highfive.hil.view.page_shown import PageShown
from highfive.hil.view.wire import PoseMessage
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model import DEFAULT_MODEL

LATE_NS = 30_000_000
"""A picture is seen so long after its pose was, ns."""


class QuietPage:
    """Pages on which somebody may press something; what they have shown they tell as late as ``tells``."""

    alive = True

    def __init__(self) -> None:
        self.pressed: list[Command] = []
        self.poses = 0
        self.tells = False
        self._pictures: list[PageShown] = []

    def show(self, message: PoseMessage) -> None:
        self.poses += 1
        picture = Shown(self.poses, message.holds_ns, message.holds_ns + LATE_NS, 0)
        self._pictures.append(PageShown(1, picture, 0))

    def tell(self, kind: str, **fields: Any) -> None: ...

    def commands(self) -> list[Command]:
        """All that was pressed, as a page gives it: whoever asks for some of it has to do so before."""
        pressed, self.pressed = self.pressed, []
        return pressed

    def shown(self) -> list[PageShown]:
        if not self.tells:
            return []
        told, self._pictures = self._pictures, []
        return told

    def said(self) -> list[str]:
        return []

    def take(self, *names: str) -> Sequence[Command]:
        taken = [one for one in self.pressed if one.name in names]
        self.pressed = [one for one in self.pressed if one.name not in names]
        return taken


class VirtualStage:
    """A stage; ``person`` is there, where one is, and ``loop`` is an arm's that takes part."""

    def __init__(
        self, clock: VirtualClock, stack: ExitStack, folder: Path, person: LivePerson | None = None, *,
        loop: ArmLoop | None = None, template: str = "high_five",
        clips: Mapping[tuple[str, int], Clip] | None = None, switch: TapSwitch | None = None,
    ) -> None:  # fmt: skip
        self.page, self.clock = QuietPage(), clock
        self.desk = Desk(self.page, clock)
        worn = load_marker_set(PERSON_SET) if person is None else person.marker_set
        scene = build_scene()
        session = Session(open_model(DEFAULT_MODEL), {"neutral": 1.0}, worn, scene, clock=clock)
        settings = SessionSettings(
            seed=3,
            model="shipped",
            trials=0,
            style=None,
            corrected=True,
            physics=False,
            arm="" if loop is None else "virtual",
        )
        self.folder = folder / "P01" / "session-1"
        self.folder.mkdir(parents=True)
        arm = None if loop is None else ArmInRun(ArmWatch(loop), live=person is not None)
        self.stage = AvatarStage(
            session, scene, self.page, self.desk, person, protocol(template), self.folder, settings,
            partial(SessionOutputs, clock=clock), clock, arm, clips=clips, switch=switch,
        )  # fmt: skip
        stack.callback(self.stage.close)

    def play(
        self, block: str, mode: str, ask: int, source: TrialRow | None = None, style: str = "neutral", clip: int = 0,
        cell: str = "B2",
    ) -> TrialRow:  # fmt: skip
        """Plays one trial; its row."""
        trial = PlannedTrial(
            name=f"{block}-01", block=block, mode=mode, style=style, weights={style: 1.0}, answer=style,
            cell=cell, clip=clip, source="" if source is None else source.trial,
        )  # fmt: skip
        self.desk.begin_trial()
        played = self.stage.play(Asked(trial, ask, {style: 1.0}, source), lambda: None)
        about = head()
        return TrialRow(
            ask=ask, participant=about.participant, session=1, block=block, trial=trial.name, condition=mode,
            style=style, expected=style, cell=cell, clip=clip, source_trial=trial.source, viewpoint="", own_arm="",
            software="1", seed=1, calibration="", simulated=True, begun_utc_ns=0, utc_ns=0,
            recording=played.recording, contact_ns=played.contact_ns, ended_ns=played.ended_ns,
        )  # fmt: skip
