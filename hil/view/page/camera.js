// From where it is seen: fixed views that one can turn, or through her eyes. What is looked at stands clear of the panels.

import { OrbitControls, PerspectiveCamera, Quaternion, Vector3 } from "./three.js";

const EYES = [0.09, 0, 0.09], GLANCE = 0.2;
const VIEWS = {  // eye and what is looked at, in the world: z up, m; and width and height that must be seen
  orbit: [[1.95, -3.0, 1.75], [0.5, 0, 0.86], [1.95, 2.3]],
  side: [[0.5, -3.6, 1.15], [0.5, 0, 0.88], [1.95, 2.15]],
  palms: [[0.72, -1.5, 1.62], [0.5, 0, 1.38], [1.25, 0.8]],
};
const GAZE = 0.02, CHEST = 1.32;  // share of the way in a picture; m
const FURTHEST = 8;  // m, unless panels leave so little that it must be more
const OPEN = 34, HERS = 62, WIDEST = 86, ACROSS = 24;  // degrees from top to bottom, and to either side

export class Eye {
  constructor(canvas) {
    this.camera = new PerspectiveCamera(OPEN, 1, 0.03, 40);
    this.orbit = new OrbitControls(this.camera, canvas);
    Object.assign(this.orbit, { enableDamping: true, dampingFactor: 0.12, minDistance: 0.5, maxPolarAngle: 1.62 });
    this.size = [1, 1];
    this.free = { left: 0, right: 0, top: 0, bottom: 0 };
    this.name = "orbit";
    this.near = false;
  }

  get fixed() { return this.name in VIEWS; }

  /** Pixels of the window, and how many at each side lie under panels. */
  fit(width, height, free) {
    this.size = [width, height];
    this.free = free;
    this.camera.aspect = width / height;
    const { left, right, top, bottom } = free;
    this.camera.setViewOffset(width, height, (right - left) / 2, (bottom - top) / 2, width, height);
    this.look(this.name);
  }

  look(name) {
    this.name = name;
    this.gaze = null;
    this.orbit.enabled = this.fixed;
    this.camera.fov = this.fixed ? OPEN : this.hers;
    this.camera.up.set(0, 1, 0);
    if (this.fixed) {
      this.away = this.distance(VIEWS[name][2]);
      this.orbit.maxDistance = Math.max(FURTHEST, this.away);
      const [eye, goal] = VIEWS[name].slice(0, 2).map(([x, y, z]) => new Vector3(x, z, -y));
      this.camera.position.copy(goal).addScaledVector(eye.sub(goal).normalize(), this.away);
      this.orbit.target.copy(goal);
      this.orbit.update();
    }
    this.camera.updateProjectionMatrix();
  }

  /** Opening of her eyes: wide enough for hands, also where the window is narrow, or who is seen within arm's reach. */
  get hers() {
    const [width, height] = this.size;
    return Math.min(Math.max(this.near ? WIDEST : HERS, (360 / Math.PI) * Math.atan((Math.tan((ACROSS * Math.PI) / 180) * height) / width)), WIDEST);
  }

  /** From which so much is seen between the panels. */
  distance([wide, tall]) {
    const [width, height] = this.size, { left, right, top, bottom } = this.free;
    const pixel = (2 * Math.tan((OPEN * Math.PI) / 360)) / height;  // m at a distance of 1 m
    return Math.max(wide / (pixel * Math.max(width - left - right, 80)), tall / (pixel * Math.max(height - top - bottom, 80)));
  }

  /** Between her eyes; ``values`` of 7 floats a body, ``world`` turns z up into y up. */
  throughHers(values, head, partner, world) {
    const at = 7 * head, turn = new Quaternion(values[at + 4], values[at + 5], values[at + 6], values[at + 3]);
    const eye = new Vector3(...EYES).applyQuaternion(turn).add(new Vector3().fromArray(values, at));
    const ahead = new Vector3(1, 0, 0).applyQuaternion(turn);
    // People look where hands will meet: below the face before them, a share of which her own head turns.
    const face = new Vector3().fromArray(values, 7 * partner).sub(eye).normalize();
    const goal = ahead.lerp(face, 1 - GLANCE).setZ(face.z - 0.26).add(eye);
    world.localToWorld(eye);
    world.localToWorld(goal);
    this.camera.position.copy(eye);
    this.camera.lookAt(goal);
  }

  /** From where her head is, in the long run, to the avatar: what a webcam says of depth would shake the picture. */
  asInAMirror(values, head, world) {
    const at = world.localToWorld(new Vector3().fromArray(values, 7 * head));
    this.gaze = this.gaze ? this.gaze.lerp(at, GAZE) : at;
    this.camera.position.copy(this.gaze);
    this.camera.lookAt(world.localToWorld(new Vector3(0, 0, CHEST)));
  }

  /** Where it is and what it sees, to be compared with later. */
  get pose() { return [...this.camera.position, ...this.camera.quaternion, this.camera.fov, ...this.size]; }
}
