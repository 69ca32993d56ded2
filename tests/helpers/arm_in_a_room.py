"""A program: an arm with a hidden truth at a serial port, and cameras that see its plate, by the machine's clock.

python arm_in_a_room.py LINK PORT SEED: the arm answers at LINK, frames are served as Vicon's at PORT, until SIGTERM.
"""

import signal
import sys
import threading
from contextlib import closing

from highfive.hil.bench.hidden_arm import drawn_truth
from highfive.hil.bench.hidden_rig import RATE_HZ, CameraFaults, PlateCamera, hidden_bus
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.emulator.emulator import Emulator
from highfive.hil.drivers.priority import go_first
from highfive.hil.runtime.clock import MACHINE
from highfive.hil.sim.arm_plant import ArmPlant
from highfive.mocap_bridge.servers.vicon import ViconServer
from highfive.model.geometry.rotations import Array


class Watched:
    """A body that is seen as it moves: by the thread that moves it, and no other."""

    def __init__(self, plant: ArmPlant, camera: PlateCamera, server: ViconServer) -> None:
        self._plant, self._camera, self._server = plant, camera, server

    def step(self, torques: Array, seconds: float) -> tuple[Array, Array]:
        answer = self._plant.step(torques, seconds)
        for frame in self._camera.arrived(MACHINE.now()):
            self._server.send(frame)
        return answer


def main(link: str, port: int, seed: int) -> None:
    truth, over = drawn_truth(seed), threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: over.set())
    with closing(ViconServer(port=port, rate_hz=RATE_HZ)) as server:

        def moves(plant: ArmPlant) -> Watched:
            return Watched(plant, PlateCamera(MACHINE, truth, plant, CameraFaults()), server)

        bus, _ = hidden_bus(truth, load_rig(), moves)
        with Emulator(bus, link=link) as emulator:
            go_first()
            print("ready", flush=True)
            emulator.run(over.is_set)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
