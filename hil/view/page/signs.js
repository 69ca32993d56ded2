// What is no body: markers, palms and the way between them, the forecast of the contact, the ring where they met.

import {
  BufferAttribute, BufferGeometry, CircleGeometry, DoubleSide, Group, InstancedMesh, Line, LineDashedMaterial, Matrix4, Mesh,
  MeshBasicMaterial, MeshLambertMaterial, PlaneGeometry, Quaternion, RingGeometry, SphereGeometry, Vector3,
} from "./three.js";
import { blot } from "./textures.js";

const FLASH_MS = 800, MOST_MARKERS = 128, NEAR_M = 0.6, TOUCHING_M = 0.012;
const AVATAR = 0xd65f1f, PERSON = 0x1f6f9c;
const ONE = new Vector3(1, 1, 1);

const glow = (color, opacity) => new MeshBasicMaterial({ color, transparent: true, opacity, depthWrite: false, side: DoubleSide, fog: false });

export class Signs extends Group {
  constructor() {
    super();
    const seen = new MeshLambertMaterial({ color: 0xffffff, emissive: 0x9fd4ea, emissiveIntensity: 0.4, fog: false });
    this.markers = new InstancedMesh(new SphereGeometry(0.0075, 10, 7), seen, MOST_MARKERS);
    this.markers.count = 0;
    this.markers.frustumCulled = false;
    this.discs = [AVATAR, PERSON].map((colour) => new Mesh(new RingGeometry(0.024, 0.033, 40), glow(colour, 0.9)));
    const ends = new BufferGeometry();
    ends.setAttribute("position", new BufferAttribute(new Float32Array(6), 3));
    this.link = new Line(ends, new LineDashedMaterial({ color: 0x35403f, dashSize: 0.014, gapSize: 0.011, transparent: true, opacity: 0.8, fog: false }));
    this.link.frustumCulled = false;
    this.cloud = new Mesh(new SphereGeometry(1, 24, 16), glow(AVATAR, 0.2));
    this.cloud.matrixAutoUpdate = false;
    this.dot = new Mesh(new SphereGeometry(0.009, 12, 8), glow(AVATAR, 0.95));
    this.flash = new Mesh(new RingGeometry(0.9, 1, 64), glow(0xffffff, 0));
    this.burst = new Mesh(new CircleGeometry(1, 48), glow(0xffe3b8, 0));
    const spot = new MeshBasicMaterial({ map: blot(), transparent: true, depthWrite: false, fog: false });
    this.blots = [0, 1].map(() => new Mesh(new PlaneGeometry(1.05, 0.86), spot));
    this.flashed = -Infinity;
    this.hidden = { markers: false, palms: false };
    this.add(this.markers, ...this.discs, this.link, this.cloud, this.dot, this.flash, this.burst, ...this.blots);
    for (const sign of this.children) sign.visible = sign === this.markers;
  }

  /** Palms: a body, and position and quaternion (w, x, y, z) on it, for each of the two; the avatar's where it is seen. */
  showPalms(values, palms, avatar) {
    palms.forEach(({ body, position, quaternion: [w, x, y, z] }, i) => {
      const at = 7 * body;
      const frame = new Matrix4().compose(
        new Vector3().fromArray(values, at), new Quaternion(values[at + 4], values[at + 5], values[at + 6], values[at + 3]), ONE,
      );
      frame.multiply(new Matrix4().compose(new Vector3().fromArray(position), new Quaternion(x, y, z, w), ONE));
      frame.decompose(this.discs[i].position, this.discs[i].quaternion, new Vector3());
    });
    const [ours, theirs] = this.discs.map((disc) => disc.position);
    const distance = ours.distanceTo(theirs), near = avatar && !this.hidden.palms && distance < NEAR_M;
    const ends = this.link.geometry.attributes.position;
    [ours, theirs].forEach((point, i) => ends.setXYZ(i, point.x, point.y, point.z));
    ends.needsUpdate = true;
    this.link.computeLineDistances();
    this.link.visible = near && distance > 2 * TOUCHING_M;
    for (const disc of this.discs) disc.visible = near && distance > TOUCHING_M;
  }

  showMarkers(points, seen) {
    const matrix = new Matrix4();
    let shown = 0;
    for (let i = 0; !this.hidden.markers && i < seen.length && shown < MOST_MARKERS; i++) {
      if (!seen[i]) continue;
      this.markers.setMatrixAt(shown++, matrix.makeTranslation(points[3 * i], points[3 * i + 1], points[3 * i + 2]));
    }
    this.markers.count = shown;
    this.markers.instanceMatrix.needsUpdate = true;
  }

  /** The forecast of the contact: its place, and the half axes of its standard deviation (columns), m. */
  showForecast(forecast) {
    this.cloud.visible = this.dot.visible = Boolean(forecast) && !this.hidden.palms;
    if (!this.cloud.visible) return;
    const [a, b, c] = forecast.axes, [x, y, z] = forecast.point;
    this.cloud.matrix.set(a[0], b[0], c[0], x, a[1], b[1], c[1], y, a[2], b[2], c[2], z, 0, 0, 0, 1);
    this.cloud.matrixWorldNeedsUpdate = true;
    this.dot.position.set(x, y, z);
  }

  /** Something to stand on where there are no shadows: under a pelvis each, or none. */
  showBlots(places) {
    places.forEach((place, i) => {
      this.blots[i].visible = Boolean(place);
      if (place) this.blots[i].position.set(place[0], place[1], 0.007);
    });
  }

  /** Palms have met there. */
  contact(where, now) {
    this.flash.position.fromArray(where);
    this.burst.position.fromArray(where);
    this.flashed = now;
  }

  /** The ring grows and fades, facing the camera. */
  move(now, camera) {
    const share = (now - this.flashed) / FLASH_MS;
    this.flash.visible = this.burst.visible = share >= 0 && share < 1;
    if (!this.flash.visible) return;
    const grown = 1 - (1 - share) ** 3;
    this.flash.scale.setScalar(0.04 + 0.24 * grown);
    this.flash.material.opacity = 0.95 * (1 - share) ** 1.5;
    this.burst.scale.setScalar(0.03 + 0.13 * grown);
    this.burst.material.opacity = 0.55 * (1 - share) ** 3;
    this.updateWorldMatrix(true, false);
    const facing = new Quaternion();
    this.getWorldQuaternion(facing).invert().multiply(camera.quaternion);
    this.flash.quaternion.copy(facing);
    this.burst.quaternion.copy(facing);
  }
}
