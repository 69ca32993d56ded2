// A worker with one net of MediaPipe, of the body or of hands: a picture in, landmarks out. It is not mirrored.

const FIRST = 25;  // landmarks of the body: head to hips
const round = (points) => points.map(({ x, y, z }) => [x, y, z]);
const FOUND = {
  pose: ({ poseLandmarks: picture, poseWorldLandmarks: world }) => (picture && world
    ? { picture: picture.slice(0, FIRST).map(({ x, y, visibility }) => [x, y, visibility]), world: round(world.slice(0, FIRST)) }
    : null),
  hands: ({ multiHandLandmarks: pictures, multiHandWorldLandmarks: worlds, multiHandedness: sides }) =>
    pictures.map((picture, i) => ({ score: sides[i].score, picture: round(picture), world: round(worlds[i]) })),
};

// The library wants to be in a page. What it asks of one is little: scripts, and a canvas that nobody sees.
self.window = self;
self.document = {
  currentScript: null,
  addEventListener() {},
  createElement(kind) {
    if (kind === "canvas") return new OffscreenCanvas(1, 1);
    const heard = {};
    return { heard, setAttribute(name, value) { this[name] = value; }, addEventListener(name, hear) { heard[name] = hear; } };
  },
  body: {
    appendChild({ src, heard }) {
      try { importScripts(src); heard.load(); } catch (error) { heard.error(error); }
    },
  },
};

let net = null, found = null, work = Promise.resolve();

async function load({ net: kind, options }) {
  const base = `/nets/${kind}/`, locateFile = (name) => base + name;
  importScripts(`${base}${kind}.js`);
  net = kind === "pose" ? new self.Pose({ locateFile }) : new self.Hands({ locateFile });
  net.setOptions(options);
  net.onResults((results) => { found = FOUND[kind](results); });
  await net.initialize();
  return { ready: true };
}

async function look({ image, atMs }) {
  found = null;
  try { await net.send({ image }, atMs); } finally { image.close(); }
  return { found };
}

self.onmessage = ({ data }) => {
  work = work.then(() => (data.net ? load(data) : look(data)))
    .then((answer) => self.postMessage(answer), (error) => self.postMessage({ error: String((error && error.message) || error) }));
};
