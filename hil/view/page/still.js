// A room that stands still is drawn once, finely, and kept behind the picture for as long as the camera does not move.

const CALM = 2;  // pictures from the same place before it is drawn

export class Still {
  /** @param {HTMLCanvasElement} canvas lies behind the picture */
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.forget();
  }

  forget() {
    this.pose = this.kept = "";
    this.calm = 0;
  }

  /** The room is behind the picture as it is seen from there; ``draw`` draws it, and says on which canvas. */
  ready(pose, draw) {
    if (pose !== this.pose) { this.pose = pose; this.calm = 0; }
    if (this.kept === pose) return true;
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
