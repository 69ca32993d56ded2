// What is said to who wears a headset: for some seconds on a panel above the avatar, as she is seen.

import { CanvasTexture, Mesh, MeshBasicMaterial, PlaneGeometry, SRGBColorSpace, Vector3 } from "./three.js";

const AWAY = 1.0, ABOVE = 0.34, WIDE = 0.62;  // m before her eyes, over them, and across
const SHOWN_MS = 7000, FADE_MS = 500, PIXELS = 1024, FONT = 60, LINE = 76, EDGE = 36, MOST_LINES = 4;

/** Words in lines that are no wider than ``width`` as ``pen`` writes. */
function lines(pen, text, width) {
  const found = [""];
  for (const word of text.split(/\s+/)) {
    const longer = found[found.length - 1] ? `${found[found.length - 1]} ${word}` : word;
    if (pen.measureText(longer).width > width && found[found.length - 1]) found.push(word);
    else found[found.length - 1] = longer;
  }
  return found.slice(0, MOST_LINES);
}

export class Spoken extends Mesh {
  constructor() {
    const canvas = Object.assign(document.createElement("canvas"), { width: PIXELS, height: 2 * EDGE + MOST_LINES * LINE });
    const map = new CanvasTexture(canvas);
    map.colorSpace = SRGBColorSpace;
    super(new PlaneGeometry(WIDE, (WIDE * canvas.height) / PIXELS), new MeshBasicMaterial({ map, transparent: true, depthWrite: false, fog: false }));
    Object.assign(this, { canvas, text: "", since: -Infinity, stands: false, visible: false, renderOrder: 900 });
  }

  /** A text; the last one is shown again to who comes later. */
  say(text, now) {
    Object.assign(this, { text, since: text ? now : -Infinity, stands: false });
    const { canvas } = this, pen = canvas.getContext("2d");
    pen.clearRect(0, 0, canvas.width, canvas.height);
    if (text) {
      pen.font = `600 ${FONT}px system-ui, sans-serif`;
      const written = lines(pen, text, PIXELS - 2 * EDGE), tall = 2 * EDGE + written.length * LINE, top = canvas.height - tall;
      pen.fillStyle = "rgba(252, 250, 246, 0.94)";
      pen.beginPath();
      pen.roundRect(0, top, PIXELS, tall, EDGE);
      pen.fill();
      pen.fillStyle = "#1f2a2a";
      pen.textAlign = "center";
      pen.textBaseline = "middle";
      written.forEach((line, i) => pen.fillText(line, PIXELS / 2, top + EDGE + (i + 0.5) * LINE));
    }
    this.material.map.needsUpdate = true;
  }

  /** Before each picture: put once where she looks, upright, then it stands still, for what moves with a head makes sick. */
  show(eyes, turn, now) {
    const left = SHOWN_MS - (now - this.since);
    this.visible = left > 0;
    if (!this.visible) return;
    this.material.opacity = Math.min(left / FADE_MS, 1);
    if (this.stands) return;
    this.stands = true;
    const ahead = new Vector3(0, 0, -1).applyQuaternion(turn).setY(0).normalize();
    this.position.copy(eyes).addScaledVector(ahead, AWAY).setY(eyes.y + ABOVE);
    this.lookAt(eyes);
  }
}
