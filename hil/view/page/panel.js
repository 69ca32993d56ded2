// A panel with words that stands in the room before who wears a headset, life-size and upright.

import { CanvasTexture, Mesh, MeshBasicMaterial, PlaneGeometry, SRGBColorSpace, Vector3 } from "./three.js";

const WIDE = 0.62;  // m
const PIXELS = 1024, FONT = 60, LINE = 76, EDGE = 36, MOST_LINES = 4;

/** Words in lines that are no wider than ``width`` as ``pen`` writes. */
export function lines(pen, text, width) {
  const found = [""];
  for (const word of text.split(/\s+/)) {
    const longer = found[found.length - 1] ? `${found[found.length - 1]} ${word}` : word;
    if (pen.measureText(longer).width > width && found[found.length - 1]) found.push(word);
    else found[found.length - 1] = longer;
  }
  return found;
}

export class Panel extends Mesh {
  constructor() {
    const canvas = Object.assign(document.createElement("canvas"), { width: PIXELS, height: 2 * EDGE + MOST_LINES * LINE });
    const map = new CanvasTexture(canvas);
    map.colorSpace = SRGBColorSpace;
    super(new PlaneGeometry(WIDE, (WIDE * canvas.height) / PIXELS), new MeshBasicMaterial({ map, transparent: true, depthWrite: false, fog: false }));
    Object.assign(this, { canvas, text: "", visible: false });
  }

  /** Puts words on it, in smaller letters where they are many; '' leaves it empty. */
  write(text) {
    this.text = text;
    const { canvas } = this, pen = canvas.getContext("2d");
    pen.clearRect(0, 0, canvas.width, canvas.height);
    this.material.map.needsUpdate = true;
    if (!text) return;
    const room = canvas.height - 2 * EDGE;
    let font = FONT, step = LINE, written = [];
    for (; ; font *= 0.9, step *= 0.9) {
      pen.font = `600 ${font}px system-ui, sans-serif`;
      written = lines(pen, text, PIXELS - 2 * EDGE);
      if (written.length * step <= room || font < 0.5 * FONT) break;
    }
    written = written.slice(0, Math.floor(room / step));
    const tall = 2 * EDGE + written.length * step, top = canvas.height - tall;
    pen.fillStyle = "rgba(252, 250, 246, 0.94)";
    pen.beginPath();
    pen.roundRect(0, top, PIXELS, tall, EDGE);
    pen.fill();
    pen.fillStyle = "#1f2a2a";
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    written.forEach((line, i) => pen.fillText(line, PIXELS / 2, top + EDGE + (i + 0.5) * step));
  }

  /** Stands so far before eyes that look there, and so far above them, m, and faces them. */
  stand(eyes, turn, away, above) {
    const ahead = new Vector3(0, 0, -1).applyQuaternion(turn).setY(0).normalize();
    this.position.copy(eyes).addScaledVector(ahead, away).setY(eyes.y + above);
    this.lookAt(eyes);
  }
}
