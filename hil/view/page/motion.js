// Where everything is when the picture is shown: between the last two poses, or a little beyond the newest.

const FURTHEST = 25, LONGEST_GAP = 100;  // ms

export class Motion {
  constructor() { this.before = this.newest = null; }

  add(poses) {
    const jumped = this.newest && (poses.holds <= this.newest.holds || poses.bodies.length !== this.newest.bodies.length);
    this.before = jumped ? null : this.newest;
    this.newest = poses;
    this.shown = new Float32Array(poses.bodies.length);
  }

  /** Bodies (7 floats each) at a time of the host's clock, ms; for when they are; and how old, ms, the newest pose is. */
  at(time) {
    const { before, newest } = this;
    if (!newest) return null;
    const age = time - newest.holds;
    const span = before ? newest.holds - before.holds : 0;
    if (!before || newest.rate === 0 || span <= 0 || span > LONGEST_GAP) return { bodies: newest.bodies, age, holds: newest.holds };
    const holds = Math.max(Math.min(time, newest.holds + FURTHEST), before.holds);
    mix(before.bodies, newest.bodies, (holds - before.holds) / span, this.shown);
    return { bodies: this.shown, age, holds };
  }
}

/** Straight lines for positions; for quaternions the normalised straight line the short way. */
export function mix(a, b, share, out) {
  for (let i = 0; i < a.length; i += 7) {
    for (let k = 0; k < 3; k++) out[i + k] = a[i + k] + share * (b[i + k] - a[i + k]);
    let dot = 0;
    for (let k = 3; k < 7; k++) dot += a[i + k] * b[i + k];
    const sign = dot < 0 ? -1 : 1;
    let length = 0;
    for (let k = 3; k < 7; k++) {
      const from = sign * a[i + k], value = from + share * (b[i + k] - from);
      out[i + k] = value;
      length += value * value;
    }
    length = Math.sqrt(length) || 1;
    for (let k = 3; k < 7; k++) out[i + k] /= length;
  }
}
