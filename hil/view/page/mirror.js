// For who gives the left hand: the world behind a mirror that stands between left and right (y turned round).

const other = (name) => name.replace(/left_|right_/, (side) => (side === "left_" ? "right_" : "left_"));

/** Poses of bodies with these names as they are behind the mirror: an arm is then the other one, not inside out. */
export function mirrored(poses, names) {
  const bodies = new Float32Array(poses.bodies.length), markers = new Float32Array(poses.markers);
  for (let b = 0; 7 * b < bodies.length; b++) {
    const twin = names.indexOf(other(names[b] || "")), at = 7 * (twin < 0 ? b : twin), v = poses.bodies;
    bodies.set([v[at], -v[at + 1], v[at + 2], v[at + 3], -v[at + 4], v[at + 5], -v[at + 6]], 7 * b);
  }
  for (let i = 1; i < markers.length; i += 3) markers[i] = -markers[i];
  return { ...poses, bodies, markers };
}

export const mirroredPoint = ([x, y, z]) => [x, -y, z];

export const mirroredForecast = (forecast) => forecast && { ...forecast, point: mirroredPoint(forecast.point), axes: forecast.axes.map(mirroredPoint) };
