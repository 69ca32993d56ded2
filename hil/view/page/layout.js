// How much of the window the panels leave to the picture.

const MOST = 0.75;  // share of the window that panels of one direction take at most
const LEAST = 0.4;  // of a side, from which on a panel bars it

/** Tells ``say`` whenever panels change how many pixels at each side lie under them. */
export function keepClear(panels, say) {
  let before = "";
  const measure = () => {
    const { innerWidth: width, innerHeight: height } = window;
    const free = { left: 0, right: 0, top: 0, bottom: 0 };
    for (const panel of panels) {
      const box = panel.getBoundingClientRect();
      if (!box.width || !box.height) continue;
      const across = box.width / width, down = box.height / height, wide = across > down;
      if (Math.max(across, down) < LEAST) continue;
      const late = wide ? box.top + box.bottom > height : box.left + box.right > width;
      const [side, taken] = wide ? (late ? ["bottom", height - box.top] : ["top", box.bottom]) : late ? ["right", width - box.left] : ["left", box.right];
      free[side] = Math.max(free[side], taken);
    }
    const shrink = (first, second, whole) => {
      const share = Math.min(1, (MOST * whole) / (free[first] + free[second] || 1));
      free[first] *= share;
      free[second] *= share;
    };
    shrink("left", "right", width);
    shrink("top", "bottom", height);
    const now = JSON.stringify([free, width, height]);
    if (now !== before) { before = now; say(free); }
  };
  const watch = new ResizeObserver(measure);
  for (const panel of panels) watch.observe(panel);
  addEventListener("resize", measure);
  measure();
}
