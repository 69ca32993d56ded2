// Where everything is when the picture is shown: between two poses, or a little beyond the newest.

const FURTHEST = 25, LONGEST_GAP = 100;  // ms
const KEPT = 24;  // poses: what slow motion needs for LEAST_SPAN, too
// How it moves, from the poses before the newest, ms of the session's time: older ones count less, the fit goes through
// the newest, and acceleration is held back (STIFF, ms⁴), for tracked hands tremble. Ticks that follow frames may be a
// millisecond apart and differ by what was predicted wrongly: nothing is judged from less than LEAST_SPAN.
const WINDOW = 34, LEAST_SPAN = 6, FADE = 10, STIFF = 1e4;

export class Motion {
  constructor() { this.clear(); }

  clear() { this.kept = []; }

  get newest() { return this.kept.at(-1) ?? null; }

  add(poses) {
    const { newest } = this;
    if (newest && leapt(newest, poses)) this.clear();
    if (this.kept.length === KEPT) this.kept.shift();
    this.kept.push(poses);
  }

  /** Bodies (7 floats each) and markers at a time of the host's clock, ms; for when they are on that clock and in the
   *  session, s; and how old, ms, the newest pose is. */
  at(time) {
    const { kept, newest } = this;
    if (!newest) return null;
    const age = time - newest.holds;
    const as = (poses, holds = poses.holds, session = poses.time) => ({ bodies: poses.bodies, markers: poses.markers, seen: poses.seen, age, holds, time: session });
    if (kept.length < 2 || newest.rate === 0) return as(newest);
    if (age <= 0) {
      const after = kept.findIndex((poses) => poses.holds >= time);
      if (after === 0) return as(kept[0]);
      const [one, other] = [kept[after - 1], kept[after]], share = (time - one.holds) / (other.holds - one.holds);
      return as(blend([one, other], [1 - share, share]), time, one.time + share * (other.time - one.time));
    }
    const ahead = Math.min(age, FURTHEST);
    const poses = this.recent();
    if (!poses.length) return as(newest);
    const shares = weights(poses.map((one) => 1000 * (one.time - newest.time)), ahead * newest.rate);
    return as(
      blend([...poses, newest], [...shares, 1 - shares.reduce((sum, one) => sum + one, 0)]),
      newest.holds + ahead, newest.time + (ahead * newest.rate) / 1000,
    );
  }

  /** The poses before the newest that say how it moves; none where they are too few, or a gap lies between. */
  recent() {
    const { kept, newest } = this;
    let first = kept.length - 1;
    for (let i = first - 1; i >= 0 && kept[i + 1].holds - kept[i].holds <= LONGEST_GAP; i--) {
      const reached = 1000 * (newest.time - kept[first].time) >= LEAST_SPAN;
      if (reached && 1000 * (newest.time - kept[i].time) > WINDOW) break;
      first = i;
    }
    return 1000 * (newest.time - kept[first].time) >= LEAST_SPAN ? kept.slice(first, -1) : [];
  }
}

/** Whether one does not go on where the other was: both clocks go forward, and together. */
function leapt(one, next) {
  const passed = next.holds - one.holds, played = 1000 * (next.time - one.time);
  return passed <= 0 || played < 0 || Math.abs(played - next.rate * passed) > LONGEST_GAP
    || next.bodies.length !== one.bodies.length || next.markers.length !== one.markers.length;
}

/** Shares of poses ``times`` ms (below 0) from the newest in the pose ``ahead`` ms after it, which has the rest: least
 *  squares for velocity and acceleration. */
function weights(times, ahead) {
  let tt = 0, ttt = 0, tttt = STIFF;
  for (const t of times) {
    const w = Math.exp(t / FADE);
    tt += w * t * t; ttt += w * t ** 3; tttt += w * t ** 4;
  }
  const whole = tt * tttt - ttt * ttt;
  return times.map((t) => (Math.exp(t / FADE) * t * (ahead * (tttt - t * ttt) + ahead * ahead * (t * tt - ttt))) / whole);
}

/** Poses in these shares: places as they are, quaternions turned to the last one's side and made whole. */
export function blend(poses, shares) {
  const last = poses.at(-1), bodies = new Float32Array(last.bodies.length), markers = new Float32Array(last.markers.length);
  poses.forEach((one, n) => {
    const a = one.bodies, b = last.bodies, share = shares[n];
    for (let i = 0; i < a.length; i += 7) {
      const side = a[i + 3] * b[i + 3] + a[i + 4] * b[i + 4] + a[i + 5] * b[i + 5] + a[i + 6] * b[i + 6] < 0 ? -share : share;
      for (let k = 0; k < 3; k++) bodies[i + k] += share * a[i + k];
      for (let k = 3; k < 7; k++) bodies[i + k] += side * a[i + k];
    }
  });
  for (let i = 0; i < bodies.length; i += 7) {
    const length = Math.hypot(bodies[i + 3], bodies[i + 4], bodies[i + 5], bodies[i + 6]) || 1;
    for (let k = 3; k < 7; k++) bodies[i + k] /= length;
  }
  for (let m = 0; m < last.seen.length; m++) {  // one that was not seen in all of them stands where it is now
    const whole = poses.every((one) => one.seen[m]);
    for (let k = 3 * m; k < 3 * m + 3; k++) {
      if (!whole) { markers[k] = last.markers[k]; continue; }
      poses.forEach((one, n) => { markers[k] += shares[n] * one.markers[k]; });
    }
  }
  return { bodies, markers, seen: last.seen, holds: last.holds, time: last.time };
}
