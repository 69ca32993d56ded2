# MuJoCo's compiled bindings ship no types. This is what the project uses of them, from MuJoCo 3.17; a new name is a new
# line here. Specifications (MjSpec and what it holds), options and visuals are built rather than computed with: Any.
# A field of nj rows (joints), ng (geoms), ns (sites), nb (bodies), nv, nq or nu is as MuJoCo's XML reference says.

from enum import IntEnum
from os import PathLike
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

_Floats: TypeAlias = NDArray[np.float64]
_Integers: TypeAlias = NDArray[np.int32]

class _Built:
    def __getattr__(self, name: str) -> Any: ...
    def __setattr__(self, name: str, value: Any) -> None: ...

class MjSpec(_Built):
    @classmethod
    def from_file(cls, filename: str | PathLike[str]) -> Self: ...
    def compile(self) -> MjModel: ...
    def to_xml(self) -> str: ...

class MjsBody(_Built): ...
class MjOption(_Built): ...
class MjVisual(_Built): ...
class MjvOption(_Built): ...
class MjvCamera(_Built): ...

class _Named:
    id: int
    name: str

class _Joint(_Named):
    dofadr: _Integers
    qposadr: _Integers

class _Body(_Named):
    mocapid: _Integers

class _Geom(_Named):
    type: _Integers
    size: _Floats

class _JointState:
    qpos: _Floats

class MjModel:
    nv: int
    nu: int
    njnt: int
    ngeom: int
    opt: MjOption
    vis: MjVisual
    jnt_dofadr: _Integers
    jnt_qposadr: _Integers
    dof_bodyid: _Integers
    dof_jntid: _Integers
    body_parentid: _Integers
    body_mass: _Floats
    body_inertia: _Floats
    jnt_bodyid: _Integers
    jnt_range: _Floats
    jnt_limited: _Integers
    geom_bodyid: _Integers
    actuator_trnid: _Integers
    actuator_gainprm: _Floats
    actuator_biasprm: _Floats
    cam_fovy: _Floats
    nbody: int
    nmat: int
    nskin: int
    geom_pos: _Floats
    geom_quat: _Floats
    geom_size: _Floats
    geom_rgba: _Floats
    skin_rgba: _Floats
    mat_rgba: _Floats
    mat_specular: _Floats
    site_pos: _Floats
    site_quat: _Floats
    skin_bonebindpos: _Floats
    skin_bonebindquat: _Floats
    skin_bonevertweight: _Floats
    skin_vert: _Floats
    geom_group: _Integers
    geom_matid: _Integers
    geom_type: _Integers
    site_bodyid: _Integers
    skin_boneadr: _Integers
    skin_bonebodyid: _Integers
    skin_bonenum: _Integers
    skin_bonevertadr: _Integers
    skin_bonevertid: _Integers
    skin_bonevertnum: _Integers
    skin_face: _Integers
    skin_faceadr: _Integers
    skin_facenum: _Integers
    skin_matid: _Integers
    skin_vertadr: _Integers
    skin_vertnum: _Integers
    @classmethod
    def from_xml_string(cls, xml: str) -> Self: ...
    def joint(self, name: str | int) -> _Joint: ...
    def body(self, name: str | int) -> _Body: ...
    def geom(self, name: str | int) -> _Geom: ...
    def site(self, name: str | int) -> _Named: ...
    def actuator(self, name: str | int) -> _Named: ...
    def camera(self, name: str | int) -> _Named: ...
    def mat(self, name: str | int) -> _Named: ...
    def skin(self, name: str | int) -> _Named: ...

class _Contacts:
    dist: _Floats
    pos: _Floats
    frame: _Floats
    geom: _Integers

class MjData:
    def __init__(self, model: MjModel) -> None: ...
    model: MjModel
    ncon: int
    contact: _Contacts
    xquat: _Floats
    qpos: _Floats
    qvel: _Floats
    qacc: _Floats
    ctrl: _Floats
    mocap_pos: _Floats
    mocap_quat: _Floats
    qfrc_applied: _Floats
    qfrc_bias: _Floats
    qfrc_inverse: _Floats
    xpos: _Floats
    xipos: _Floats
    ximat: _Floats
    xmat: _Floats
    xanchor: _Floats
    xaxis: _Floats
    cvel: _Floats
    geom_xpos: _Floats
    geom_xmat: _Floats
    site_xpos: _Floats
    site_xmat: _Floats
    cam_xpos: _Floats
    cam_xmat: _Floats
    def joint(self, name: str | int) -> _JointState: ...

class Renderer:
    scene: Any
    def __init__(self, model: MjModel, height: int = 240, width: int = 320) -> None: ...
    def update_scene(
        self, data: MjData, camera: int | str | MjvCamera = -1, scene_option: MjvOption | None = None
    ) -> None: ...
    def render(self) -> NDArray[np.uint8]: ...
    def close(self) -> None: ...

def mj_camlight(m: MjModel, d: MjData) -> None: ...
def mj_collision(m: MjModel, d: MjData) -> None: ...
def mj_comPos(m: MjModel, d: MjData) -> None: ...
def mj_comVel(m: MjModel, d: MjData) -> None: ...
def mj_contactForce(m: MjModel, d: MjData, id: int, result: _Floats) -> None: ...
def mj_forward(m: MjModel, d: MjData) -> None: ...
def mj_fullM(m: MjModel, d: MjData, dst: _Floats) -> None: ...
def mj_inverse(m: MjModel, d: MjData) -> None: ...
def mj_jacSite(m: MjModel, d: MjData, jacp: _Floats | None, jacr: _Floats | None, site: int) -> None: ...
def mj_kinematics(m: MjModel, d: MjData) -> None: ...
def mj_objectVelocity(m: MjModel, d: MjData, objtype: mjtObj, objid: int, res: _Floats, flg_local: int) -> None: ...
def mj_resetData(m: MjModel, d: MjData) -> None: ...
def mj_step(m: MjModel, d: MjData, nstep: int = 1) -> None: ...
def mju_boxQP(
    res: _Floats, R: _Floats, index: _Integers, H: _Floats, g: _Floats, lower: _Floats, upper: _Floats
) -> int: ...
def mju_cross(res: _Floats, a: _Floats, b: _Floats) -> None: ...
def mju_mat2Quat(quat: _Floats, mat: _Floats) -> None: ...
def mju_quat2Mat(res: _Floats, quat: _Floats) -> None: ...
def mju_quatIntegrate(quat: _Floats, vel: _Floats, scale: float) -> None: ...
def mju_subQuat(res: _Floats, qa: _Floats, qb: _Floats) -> None: ...

class mjtObj(IntEnum):
    mjOBJ_BODY = 1
    mjOBJ_SITE = 6

class mjtGeom(IntEnum):
    mjGEOM_PLANE = 0
    mjGEOM_SPHERE = 2
    mjGEOM_CAPSULE = 3
    mjGEOM_ELLIPSOID = 4
    mjGEOM_CYLINDER = 5
    mjGEOM_BOX = 6

class mjtJoint(IntEnum):
    mjJNT_SLIDE = 2
    mjJNT_HINGE = 3

class mjtTrn(IntEnum):
    mjTRN_JOINT = 0

class mjtEq(IntEnum):
    mjEQ_WELD = 1

class mjtLimited(IntEnum):
    mjLIMITED_TRUE = 1

class mjtIntegrator(IntEnum):
    mjINT_IMPLICITFAST = 3

class mjtDisableBit(IntEnum):
    mjDSBL_CONSTRAINT = 1

class mjtRndFlag(IntEnum):
    mjRND_SHADOW = 0
