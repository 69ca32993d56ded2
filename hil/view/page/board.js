// What an experiment asks of who wears a headset: a board before her. She points with a ray from her hand or controller,
// and chooses with a pinch or the trigger.

import { markdown } from "./markdown.js";
import { lines } from "./panel.js";
import { BufferAttribute, BufferGeometry, CanvasTexture, CircleGeometry, Line, LineBasicMaterial, Matrix4, Mesh, MeshBasicMaterial, PlaneGeometry, Quaternion, SRGBColorSpace, Vector3 } from "./three.js";

const WIDE = 0.84, AWAY = 0.95, BELOW = 0.1;  // m: before her eyes, and below them
const WIDTH = 1024, HEIGHT = 860, EDGE = 44, GAP = 22, BUTTON = 104, DOT = 24, STEPS = 11, LETTERS = 44, LEAST = 28;
const INK = "#1f2a2a", PAPER = "rgba(252, 250, 246, 0.97)", CHOSEN = "#1f6f9c", POINTED = "#d9e8f0", QUIET = "#c9c7c1";
const FONT = "system-ui, sans-serif";

/** What she is to do in a trial. */
export const taskOf = ({ taps, words }, task) => (task === "watch" ? words.only_watch : taps ? words.tap : words.raise_hand);

/** What stands on it in a phase: words, and what can be chosen: ``{ text, big }``, ``{ label, act, chosen }`` in rows, or
 *  a row of dots. */
export class Board extends Mesh {
  /** Asks for ``participant``, whose ``now`` and ``about`` say what. */
  constructor(participant) {
    const canvas = Object.assign(document.createElement("canvas"), { width: WIDTH, height: HEIGHT });
    const map = new CanvasTexture(canvas);
    map.colorSpace = SRGBColorSpace;
    super(new PlaneGeometry(WIDE, (WIDE * HEIGHT) / WIDTH), new MeshBasicMaterial({ map, transparent: true, depthWrite: false, fog: false }));
    Object.assign(this, { canvas, participant, places: [], page: 0, rated: {}, pointed: [null, null], phase: "", stands: false, visible: false, renderOrder: 950 });
    this.rays = [0, 1].map(() => this.ray());
  }

  ray() {
    const ends = new BufferGeometry();
    ends.setAttribute("position", new BufferAttribute(new Float32Array(6), 3));
    const line = new Line(ends, new LineBasicMaterial({ color: 0x1f6f9c, transparent: true, opacity: 0.7, fog: false }));
    line.spot = new Mesh(new CircleGeometry(0.008, 20), new MeshBasicMaterial({ color: 0x1f6f9c, depthTest: false, fog: false }));
    line.spot.renderOrder = 960;
    line.frustumCulled = line.visible = line.spot.visible = false;
    return line;
  }

  /** Puts itself, and its rays, into a scene. */
  enter(scene) { scene.add(this, ...this.rays, ...this.rays.map((line) => line.spot)); }

  /** The phase is another, or what is asked in it. */
  tell(now) {
    const phase = `${now.phase} ${now.asks || ""}`;
    if (phase !== this.phase) Object.assign(this, { page: 0, stands: now.phase === "question" && this.phase.startsWith("question") && this.stands, rated: {} });
    this.phase = phase;
    this.draw();
  }

  /** What stands there now, from top to bottom; nothing where she is to see the avatar. */
  content() {
    const { now, about } = this.participant;
    const ask = (label, act, chosen = false) => ({ label, act, chosen });
    const { connection } = this.participant;
    if (!about) return [];
    const { words, shown } = about;
    if (now.phase === "ready") {
      const said = now.first ? markdown(about.instructions).flatMap(paragraphs) : [];
      if (now.text || !now.first) said.push({ text: now.text || (now.practice ? words.practice : words.next_block), big: true });
      return [...said, { text: taskOf(about, now.task) }, { buttons: [ask(words.go_on, () => connection.command("ready"))] }];
    }
    if (now.phase === "pause") return [{ text: words.pause, big: true }];
    if (now.phase === "over") return [{ text: now.finished ? words.finished : words.ends, big: true }];
    if (now.phase !== "question") return [];
    if (now.asks === "rate") {
      return [...about.sliders.map((slider) => ({ slider })), { buttons: [ask(words.done, () => this.participant.done())] }];
    }
    const keys = Object.entries(about.keys).sort((a, b) => a[1].localeCompare(b[1]));
    return [{ text: words.question, big: true }, { buttons: keys.map(([label, key]) => ask(shown[label], (at) => this.participant.answer(key, at), label === now.answer)) }];
  }

  draw() {
    let content = this.content();
    const pen = this.canvas.getContext("2d");
    this.places = [];
    this.empty = !content.length;
    this.material.map.needsUpdate = true;
    pen.clearRect(0, 0, WIDTH, HEIGHT);
    if (this.empty) return;
    pen.textBaseline = "middle";
    let size = LETTERS, fits = (shown) => this.lay(pen, shown, size, false) <= HEIGHT - EDGE;
    while (size > LEAST && !fits(content)) size *= 0.9;  // in smaller letters where there is much
    if (!fits(content)) content = this.turned(content, fits);
    const tall = Math.min(this.lay(pen, content, size, false) + EDGE - GAP, HEIGHT);
    pen.fillStyle = PAPER;
    pen.beginPath();
    pen.roundRect(0, 0, WIDTH, tall, EDGE);
    pen.fill();
    this.lay(pen, content, size, true);
  }

  /** The page that is open, of what does not fit on one; it ends with what leads to the next. */
  turned(content, fits) {
    const more = { buttons: [{ label: this.participant.about.words.more, act: () => { this.page += 1; this.draw(); }, chosen: false }] }, pages = [[]];
    for (const [i, one] of content.entries()) {
      const page = pages[pages.length - 1], rest = i + 1 < content.length ? [more] : [];
      if (page.length && !fits([...page, one, ...rest])) pages.push([one]);
      else page.push(one);
    }
    const last = pages.length - 1;
    this.page = Math.min(this.page, last);
    return this.page < last ? [...pages[this.page], more] : pages[last];
  }

  /** Where it ends, from the top; ``paint`` draws it. */
  lay(pen, content, size, paint) {
    let top = EDGE;
    for (const one of content) {
      if (one.text) top = this.words(pen, one, size, top, paint);
      if (one.buttons) top = this.buttons(pen, one.buttons, size, top, paint);
      if (one.slider) top = this.slider(pen, one.slider, size, top, paint);
      top += GAP;
    }
    return top;
  }

  words(pen, { text, big }, size, top, paint) {
    const step = 1.25 * size * (big ? 1.2 : 1);
    pen.font = `${big ? 650 : 450} ${size * (big ? 1.2 : 1)}px ${FONT}`;
    pen.textAlign = big ? "center" : "left";
    const written = lines(pen, text, WIDTH - 2 * EDGE);
    pen.fillStyle = INK;
    if (paint) written.forEach((line, i) => pen.fillText(line, big ? WIDTH / 2 : EDGE, top + (i + 0.5) * step));
    return top + written.length * step;
  }

  buttons(pen, all, size, top, paint) {
    const across = all.length === 4 ? 2 : Math.min(all.length, 3), wide = (WIDTH - 2 * EDGE - (across - 1) * GAP) / across;
    all.forEach((button, i) => {
      if (!paint) return;
      const x = EDGE + (i % across) * (wide + GAP), y = top + Math.floor(i / across) * (BUTTON + GAP);
      this.box(pen, { x, y, wide, tall: BUTTON }, button.label, button.act, button.chosen, size);
    });
    return top + Math.ceil(all.length / across) * (BUTTON + GAP) - GAP;
  }

  box(pen, { x, y, wide, tall }, label, act, chosen, size) {
    const place = { x, y, wide, tall, act, name: label };
    this.places.push(place);
    pen.fillStyle = chosen ? CHOSEN : this.pointed.includes(label) ? POINTED : "white";
    pen.strokeStyle = this.pointed.includes(label) ? CHOSEN : QUIET;
    pen.lineWidth = 4;
    pen.beginPath();
    pen.roundRect(x, y, wide, tall, 18);
    pen.fill();
    pen.stroke();
    pen.fillStyle = chosen ? "white" : INK;
    pen.textAlign = "center";
    pen.font = `600 ${Math.min(size, 40)}px ${FONT}`;
    pen.fillText(label, x + wide / 2, y + tall / 2, wide - 20);
  }

  slider(pen, { name, text, low, high, points }, size, top, paint) {
    const count = points || STEPS, edge = EDGE + 2 * DOT, apart = (WIDTH - 2 * edge) / (count - 1);
    const under = this.words(pen, { text }, size, top, paint) + 1.6 * DOT;
    if (paint) {
      for (let i = 0; i < count; i++) {
        const value = points ? i + 1 : i / (count - 1), key = `${name} ${i}`, x = edge + i * apart;
        this.places.push({ x: x - apart / 2, y: under - 1.7 * DOT, wide: apart, tall: 3.4 * DOT, name: key, act: () => this.rate(name, value) });
        pen.beginPath();
        pen.arc(x, under, this.pointed.includes(key) ? 1.2 * DOT : DOT, 0, 2 * Math.PI);
        pen.fillStyle = this.rated[name] === value ? CHOSEN : this.pointed.includes(key) ? POINTED : "white";
        pen.fill();
        pen.lineWidth = 4;
        pen.strokeStyle = QUIET;
        pen.stroke();
      }
      pen.fillStyle = INK;
      pen.font = `450 ${0.8 * size}px ${FONT}`;
      [[low, "left", EDGE], [high, "right", WIDTH - EDGE]].forEach(([word, side, x]) => {
        pen.textAlign = side;
        pen.fillText(word, x, under + 1.7 * DOT + 0.5 * size, WIDTH / 2 - EDGE);
      });
    }
    return under + 1.7 * DOT + size;
  }

  rate(name, value) {
    this.rated[name] = value;
    this.participant.connection.command("rate", { name, value });
    this.draw();
  }

  /** Before each picture: put once where she looks; ``rays`` are the left and the right hand's, or null. */
  show(eyes, turn, rays) {
    this.visible = !this.empty;
    if (this.visible && !this.stands) {
      const ahead = new Vector3(0, 0, -1).applyQuaternion(turn).setY(0).normalize();
      this.position.copy(eyes).addScaledVector(ahead, AWAY).setY(eyes.y - BELOW);
      this.lookAt(eyes.x, this.position.y, eyes.z);
      this.updateMatrixWorld(true);
      this.stands = true;
    }
    const before = this.pointed;
    this.pointed = rays.map((ray, side) => this.point(this.rays[side], ray));
    if (this.visible && String(before) !== String(this.pointed)) this.draw();
  }

  /** The name of what a ray points at, or null; draws the ray. */
  point(line, ray) {
    const hit = this.visible && ray ? this.hit(ray) : null;
    line.visible = line.spot.visible = Boolean(hit);
    if (!hit) return null;
    const ends = line.geometry.attributes.position;
    [ray.origin, hit.at].forEach((end, i) => ends.setXYZ(i, end.x, end.y, end.z));
    ends.needsUpdate = true;
    line.spot.position.copy(hit.at);
    line.spot.quaternion.copy(this.quaternion);
    return hit.place?.name ?? null;
  }

  /** Where a ray meets the board, and what is there; null where it passes. */
  hit({ origin, direction }) {
    const back = new Matrix4().copy(this.matrixWorld).invert();
    const from = origin.clone().applyMatrix4(back), way = direction.clone().transformDirection(back);
    const far = -from.z / way.z;
    if (!(far > 0)) return null;
    const x = (from.x + far * way.x) / WIDE + 0.5, y = 0.5 - ((from.y + far * way.y) * WIDTH) / (WIDE * HEIGHT);
    if (x < 0 || x > 1 || y < 0 || y > 1) return null;
    const [u, v] = [x * WIDTH, y * HEIGHT];
    const place = this.places.find((one) => u >= one.x && u <= one.x + one.wide && v >= one.y && v <= one.y + one.tall);
    return { at: origin.clone().addScaledVector(direction, far), place };
  }

  /** What a ray points at is chosen, at a time of this browser, ms. */
  choose(ray, at) {
    const place = this.visible && ray ? this.hit(ray)?.place : null;
    place?.act(at);
  }

  leave() { this.visible = this.stands = false; for (const line of this.rays) line.visible = line.spot.visible = false; }
}

/** Of a block of the instructions: itself, or each item of a list. */
function paragraphs(block) {
  const items = [...block.querySelectorAll("li")];
  return items.length ? items.map((item) => ({ text: `• ${item.textContent}` })) : [{ text: block.textContent }];
}

/** The ray of an input source in a frame, or null where it is not tracked. */
export function rayOf(source, frame, space) {
  const pose = source.targetRaySpace && frame.getPose(source.targetRaySpace, space);
  if (!pose) return null;
  const { position, orientation } = pose.transform;
  const turn = new Quaternion(orientation.x, orientation.y, orientation.z, orientation.w);
  return { origin: new Vector3(position.x, position.y, position.z), direction: new Vector3(0, 0, -1).applyQuaternion(turn) };
}
