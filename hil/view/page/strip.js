// Strip charts on small canvases.

const INK = "#25302f", FAINT = "rgba(37,48,47,0.14)", DEEP = 2, GAP_S = 0.4;

function fit(canvas) {
  const width = canvas.clientWidth * DEEP, height = canvas.clientHeight * DEEP;
  if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

/** The last seconds of one value, newest at the right. */
export class Strip {
  constructor(canvas, { seconds = 8, top = 1, colour = INK } = {}) {
    Object.assign(this, { canvas, seconds, top, colour, points: [] });
  }

  clear() { this.points = []; this.fresh = true; }

  /** What came after ``time`` before somebody went back to it is gone; what was skipped is a gap. */
  add(time, value) {
    const { points } = this, last = points.length ? points[points.length - 1][0] : time;
    if (time === last && points.length) return;
    while (points.length && points[points.length - 1][0] >= time) points.pop();
    if (time > last + GAP_S) points.push([time, null]);
    this.fresh = true;
    points.push([time, value]);
    while (points.length && points[0][0] < time - this.seconds) points.shift();
  }

  /** Again, if something has come since. */
  draw() {
    if (!this.canvas.clientWidth || !this.fresh) return;
    this.fresh = false;
    const { context, width, height } = fit(this.canvas);
    context.strokeStyle = FAINT;
    context.lineWidth = 1;
    for (const level of [0, 0.5, 1]) {
      context.beginPath();
      context.moveTo(0, 1 + level * (height - 2));
      context.lineTo(width, 1 + level * (height - 2));
      context.stroke();
    }
    if (!this.points.length) return;
    const end = this.points[this.points.length - 1][0];
    context.strokeStyle = this.colour;
    context.lineWidth = 3;
    context.lineJoin = context.lineCap = "round";
    context.beginPath();
    let drawing = false;
    for (const [time, value] of this.points) {
      if (value === null || value === undefined) { drawing = false; continue; }
      const x = width * (1 - (end - time) / this.seconds);
      const y = (height - 4) * (1 - Math.min(Math.max(value / this.top, 0), 1)) + 2;
      if (drawing) context.lineTo(x, y); else { context.moveTo(x - 0.1, y); context.lineTo(x, y); }  // one alone is a dot
      drawing = true;
    }
    context.stroke();
  }
}

/** One bar a contact: how far the palms were apart; a cross where they missed. */
export class Contacts {
  constructor(canvas, { least = 2, most = 12 } = {}) { Object.assign(this, { canvas, least, most, bars: [] }); }

  set(bars) { this.bars = bars.slice(-this.most); this.draw(); }

  draw() {
    if (!this.canvas.clientWidth) return;
    const { context, width, height } = fit(this.canvas);
    const step = width / this.most, foot = height - 2;
    const top = Math.max(this.least, ...this.bars.filter((bar) => bar.met).map((bar) => 1000 * bar.distance));
    context.fillStyle = FAINT;
    context.fillRect(0, foot, width, 2);
    context.font = `${9 * DEEP}px system-ui, sans-serif`;  // three figures fit a bar's share of the width
    context.textAlign = "center";
    this.bars.forEach(({ distance, met, colour }, i) => {
      const x = (i + 0.5) * step;
      context.fillStyle = colour;
      if (!met) { context.fillText("×", x, foot - 6); return; }
      const tall = Math.max((foot - 22) * Math.min((1000 * distance) / top, 1), 4);
      context.beginPath();
      context.roundRect(x - step * 0.28, foot - tall, step * 0.56, tall, 4);
      context.fill();
      context.fillText((1000 * distance).toFixed(distance < 0.001 ? 1 : 0), x, foot - tall - 5);
    });
  }
}
