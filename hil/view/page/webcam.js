// The webcam as motion capture: pictures to the nets, landmarks to the host; a mirror with what is seen, and what is wrong.

const KIND = 3, VERSION = 1, HEAD = 28, POSE = 25, HAND = 21, MOST_HANDS = 4;
export const NET = { modelComplexity: 1, minDetectionConfidence: 0.5, minTrackingConfidence: 0.5 };
const SURE = 0.5, WIDTH = 232, SLOW_MS = 200;
const SCAN_MS = 3000, NEARER = 1.15, MARGIN = 0.25;
const BONES = [[11, 12], [12, 14], [14, 16], [11, 13], [13, 15], [11, 23], [12, 24], [23, 24]];
const FINGERS = [[0, 5], [5, 9], [9, 13], [13, 17], [17, 0], [5, 8], [9, 12], [13, 16], [17, 20], [0, 4]];
const REFUSED = {
  NotAllowedError: "The camera was refused: allow it beside the address, and reload.",
  NotReadableError: "The camera is taken by another program: close that, and reload.",
  NotFoundError: "There is no camera here: plug one in, and reload.",
};

/** A worker with a net; one question at a time. */
export class Net {
  constructor(net, options) {
    this.worker = new Worker("nets.js");
    this.worker.onmessage = ({ data }) => this.settle(data);
    this.worker.onerror = (event) => this.settle({ error: event.message || "the worker does not start" });
    this.ready = this.ask({ net, options });
  }

  settle(data) { if (this.waiting) { const [yes, no] = this.waiting; this.waiting = null; data.error ? no(new Error(data.error)) : yes(data); } }

  ask(message, given = []) {
    return new Promise((yes, no) => { this.waiting = [yes, no]; this.worker.postMessage(message, given); });
  }

  /** What it finds in an image, which it takes. */
  async find(image, atMs) { return (await this.ask({ image, atMs }, [image])).found; }

  close() { this.worker.terminate(); this.settle({ error: "closed" }); }
}

/** As bytes: highfive/mocap_bridge/wire/landmarks.py. Times in ms of the host's clock. */
export function encodeLandmarks({ number, captured, took, width, height, persons, body, hands }) {
  const kept = hands.slice(0, MOST_HANDS);
  const floats = (body ? 6 * POSE : 0) + kept.length * (1 + 5 * HAND);
  const view = new DataView(new ArrayBuffer(HEAD + 4 * floats));
  [KIND, VERSION, body ? persons : 0, kept.length].forEach((value, at) => view.setUint8(at, value));
  view.setUint32(4, number, true);
  view.setFloat64(8, captured, true);
  view.setUint16(16, width, true);
  view.setUint16(18, height, true);
  view.setFloat64(20, took, true);
  let at = HEAD;
  const put = (value) => { view.setFloat32(at, value, true); at += 4; };
  if (body) for (let i = 0; i < POSE; i++) { const [x, y, sure] = body.picture[i]; [x, y, Math.min(Math.max(sure, 0), 1), ...body.world[i]].forEach(put); }
  for (const hand of kept) {
    put(Math.min(Math.max(hand.score, 0), 1));
    for (let i = 0; i < HAND; i++) [hand.picture[i][0], hand.picture[i][1], ...hand.world[i]].forEach(put);
  }
  return view.buffer;
}

/** What the person before the camera should do; "" where she stands well. */
export function guidance(body, width, height) {
  if (!body) return "Nobody is seen: come before the camera.";
  const at = (i) => body.picture[i];
  const inside = ([x, y, sure]) => sure >= SURE && x > 0 && x < 1 && y > 0 && y < 1;
  const trunk = Math.hypot((at(11)[0] + at(12)[0] - at(23)[0] - at(24)[0]) * width, (at(11)[1] + at(12)[1] - at(23)[1] - at(24)[1]) * height) / 2;
  if (![23, 24].every((i) => inside(at(i)))) return "A step back: your hips should be seen.";
  if (at(0)[1] * height < 0.6 * trunk) return "A step back, or tilt the camera up: there is no room over your head for the hand.";
  if (![11, 12].every((i) => inside(at(i)))) return "To the middle: both shoulders should be seen.";
  if (trunk < 0.12 * height) return "A step nearer.";
  if (at(12)[0] > at(11)[0]) return "Face the camera.";
  return "";
}

const box = (body) => {
  const xs = body.picture.map(([x]) => x), ys = body.picture.map(([, y]) => y);
  const [left, right, top, bottom] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  const wide = MARGIN * (right - left), high = MARGIN * (bottom - top);
  return [left - wide, top - high, right - left + 2 * wide, bottom - top + 2 * high];
};
const trunkOf = (body, ratio) => Math.hypot((body.picture[11][0] + body.picture[12][0] - body.picture[23][0] - body.picture[24][0]) * ratio, body.picture[11][1] + body.picture[12][1] - body.picture[23][1] - body.picture[24][1]);

export class Webcam {
  /**
   * @param {import("./connection.js").Connection} connection
   * @param {HTMLElement} panel
   * @param {{processor: boolean}} machine whether pictures are drawn by the processor: then nets run there, too
   */
  constructor(connection, panel, machine) {
    Object.assign(this, { connection, panel, machine, number: 0, period: 100, counts: { sent: 0, found: 0, restarts: 0 } });
    this.canvas = Object.assign(document.createElement("canvas"), { width: WIDTH, height: Math.round((WIDTH * 9) / 16) });
    this.canvas.setAttribute("aria-label", "What the camera sees, mirrored");
    this.line = Object.assign(document.createElement("p"), { textContent: "The camera starts …" });
    this.line.setAttribute("role", "status");
    panel.classList.add("webcam");
    panel.replaceChildren(this.canvas, this.line);
    this.video = Object.assign(document.createElement("video"), { muted: true, playsInline: true });
  }

  say(text) { if (this.line.textContent !== text) this.line.textContent = text; }

  /** The host said whether this page's camera is the one that counts. */
  granted(granted) {
    if (!granted) { this.say("Another page's camera is in use: close that page."); setTimeout(() => this.over || this.claim(), 2000); return; }
    if (!this.started) { this.started = true; this.start().catch((error) => this.say(`The camera cannot be used: ${error.message}`)); }
  }

  /** The session is over: the camera goes off. */
  end() {
    this.over = true;
    for (const track of this.video.srcObject?.getTracks() || []) track.stop();
    this.video.srcObject = null;
    for (const net of [this.body, this.hands, this.scout]) net?.close();
    this.canvas.getContext("2d").clearRect(0, 0, this.canvas.width, this.canvas.height);
    this.say("The camera is off.");
  }

  /** Asks for this page's camera to count; never again where it has none to give. */
  claim() { if (!this.none) this.connection.send({ kind: "camera" }); }

  /** There is no camera to be had here: another page's may count. */
  lacks(text) { this.none = true; this.say(text); this.connection.send({ kind: "camera", over: true }); }

  async start() {
    if (!navigator.mediaDevices) { this.lacks("This browser gives no camera here: open the page on this computer (localhost), or over https."); return; }
    if (typeof OffscreenCanvas === "undefined") { this.lacks("This browser cannot run the nets beside the page: take a newer one."); return; }
    try {
      this.video.srcObject = await navigator.mediaDevices.getUserMedia({
        audio: false, video: { width: { ideal: 1280 }, height: { ideal: 720 }, frameRate: { ideal: 30 }, facingMode: "user" },
      });
    } catch (error) {
      this.lacks(REFUSED[error.name] || `The camera cannot be used: ${error.message}`);
      return;
    }
    for (const track of this.video.srcObject.getTracks()) track.onended = () => this.say("The camera was taken away: plug it in, and reload.");
    if (this.over) { this.end(); return; }  // meanwhile
    await this.video.play();
    this.say("The nets are loaded …");
    await this.load();
    if (this.over) { this.end(); return; }
    this.say("");
    this.next();
  }

  async load() {
    const own = { ...NET, useCpuInference: this.machine.processor };
    this.body = new Net("pose", { ...own, smoothLandmarks: false });
    this.hands = new Net("hands", { ...own, maxNumHands: MOST_HANDS });
    await Promise.all([this.body.ready, this.hands.ready]);
  }

  next() {
    if (this.over) return;
    const look = (now, seen) => this.look(now, seen).catch((error) => this.restart(error)).finally(() => this.next());
    if (this.video.requestVideoFrameCallback) this.video.requestVideoFrameCallback(look);
    else requestAnimationFrame((now) => look(now, {}));
  }

  async look(now, { captureTime, presentationTime }) {
    if (this.over) return;
    const captured = captureTime ?? presentationTime ?? now;
    if (!this.connection.synchronised || this.video.readyState < 2) return;
    const images = await Promise.all([createImageBitmap(this.video), createImageBitmap(this.video)]);
    const { width, height } = images[0];
    const [body, hands] = await Promise.all([this.body.find(images[0], now), this.hands.find(images[1], now)]);
    if (this.over) return;
    await this.scan(body, now, width / height);
    const persons = body ? 1 + Number(Boolean(this.others)) : 0;
    const took = Math.max(performance.now() - captured, 0);
    this.number += 1;
    if (this.connection.socket.readyState === WebSocket.OPEN) {
      this.connection.socket.send(encodeLandmarks({
        number: this.number, captured: this.connection.host(captured), took, width, height, persons, body, hands: hands || [],
      }));
      this.counts.sent += 1;
      this.counts.found += Number(Boolean(body));
    }
    this.period += 0.2 * (now - (this.before ?? now) - this.period);
    this.before = now;
    const slow = this.number > 10 && this.period > SLOW_MS;
    this.advice = guidance(body, width, height);
    this.say([
      this.advice, persons > 1 ? "Two people are in view: the nearer one counts." : "",
      slow ? `Only ${(1000 / this.period).toFixed(1)} pictures a second are looked at here: raise the hand slowly, and hold it.` : "",
    ].filter(Boolean).join(" "));
    this.draw(body, hands || [], width, height);
  }

  /**
   * Whether somebody else is in view, and nearer. The body's net follows one person; now and then it is asked for another
   * where that one is not. The net is then told to begin with whoever is nearer.
   */
  async scan(body, now, ratio) {
    if (!body || now < (this.scanned || 0) + SCAN_MS) return;
    this.scanned = now;
    if (!this.scout) { this.scout = new Net("pose", { ...NET, useCpuInference: this.machine.processor, smoothLandmarks: false }); await this.scout.ready; }
    const masked = await this.masked(box(body));
    const other = await this.scout.find(masked, now);
    const sure = other && [11, 12, 23, 24].every((i) => other.picture[i][2] >= SURE);
    this.others = Boolean(sure);
    if (sure && trunkOf(other, ratio) > NEARER * trunkOf(body, ratio)) [this.body, this.scout] = [this.scout, this.body];
  }

  /** The picture without what is in a box, of shares of its size. */
  async masked([x, y, wide, high]) {
    const canvas = new OffscreenCanvas(this.video.videoWidth, this.video.videoHeight), pen = canvas.getContext("2d");
    pen.drawImage(this.video, 0, 0);
    pen.fillStyle = "#777";
    pen.fillRect(x * canvas.width, y * canvas.height, wide * canvas.width, high * canvas.height);
    return createImageBitmap(canvas);
  }

  /** A net that fell over is begun anew. */
  async restart(error) {
    if (this.over) return;
    this.counts.restarts += 1;
    console.warn(`nets begun anew: ${error.message}`);
    for (const net of [this.body, this.hands, this.scout]) net?.close();
    this.scout = null;
    await this.load().catch((again) => this.say(`The nets do not run here: ${again.message}`));
  }

  /** Mirrored, as people know themselves. What is not sure is drawn pale. */
  draw(body, hands, width, height) {
    const pen = this.canvas.getContext("2d"), [w, h] = [this.canvas.width, this.canvas.height];
    const scale = Math.min(w / width, h / height), [wide, high] = [width * scale, height * scale];
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, w, h);
    pen.setTransform(-1, 0, 0, 1, (w + wide) / 2, (h - high) / 2);
    pen.drawImage(this.video, 0, 0, wide, high);
    const line = (points, [a, b], colour, sure) => {
      pen.globalAlpha = sure ? 1 : 0.25;
      pen.strokeStyle = colour;
      pen.lineWidth = 2;
      pen.beginPath();
      pen.moveTo(points[a][0] * wide, points[a][1] * high);
      pen.lineTo(points[b][0] * wide, points[b][1] * high);
      pen.stroke();
    };
    if (body) for (const bone of BONES) line(body.picture, bone, "#ffffff", bone.every((i) => body.picture[i][2] >= SURE));
    for (const hand of hands) for (const bone of FINGERS) line(hand.picture, bone, "#f0a35e", hand.score >= SURE);
    pen.globalAlpha = 1;
  }
}
