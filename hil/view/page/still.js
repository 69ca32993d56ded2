// A room that stands still is drawn once, finely, and kept behind the picture for as long as the camera does not move.

const CALM = 2;  // pictures from the same place before it is drawn
const STILL = 1e-4;  // m, or share of a turn: controls that damp never come to rest in the last digits

const same = (a, b) => a.length === b.length && a.every((value, i) => Math.abs(value - b[i]) < STILL);

export class Still {
  /** @param {HTMLCanvasElement} canvas lies behind the picture */
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.forget();
  }

  forget() {
    this.pose = this.kept = [];
    this.calm = 0;
  }

  /** The room is behind the picture as it is seen from there; ``draw`` draws it, and says on which canvas. */
  ready(pose, draw) {
    if (same(pose, this.kept)) return true;
    if (!same(pose, this.pose)) { this.pose = pose; this.calm = 0; }
    this.calm += 1;
    if (this.calm < CALM) return false;
    const { canvas, after } = draw();
    this.canvas.width = canvas.clientWidth;
    this.canvas.height = canvas.clientHeight;
    this.context.imageSmoothingQuality = "high";
    this.context.drawImage(canvas, 0, 0, this.canvas.width, this.canvas.height);
    after();
    this.kept = pose;
    return true;
  }
}
