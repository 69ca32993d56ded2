// Moods: their colours, and how a mixture is put in words.

const COLOURS = { angry: "#c0392b", happy: "#b97a08", neutral: "#5d7a78", sad: "#3b6ea5" };
const SPARE = ["#7a5ea8", "#3c8d5a", "#b0567c", "#6b6b6b"];

export const colourOf = (emotion, place = 0) => COLOURS[emotion] || SPARE[place % SPARE.length];

/** Weights by emotion of a style that a recording names: ``happy``, or ``happy 0.5 + neutral 0.5``. */
export function weightsOf(style) {
  return Object.fromEntries(style.split(" + ").filter(Boolean).map((part) => {
    const [, name, weight] = /^(.*?)(?: (\d*\.?\d+))?$/.exec(part);
    return [name, Number(weight ?? 1)];
  }));
}

/** Weights by emotion as words: one alone by its name, a mixture with its shares, each of which stays on one line. */
export function moodOf(weights) {
  const kept = Object.entries(weights).filter(([, weight]) => weight > 0.01).sort((a, b) => b[1] - a[1]);
  if (kept.length === 1) return kept[0][0];
  return kept.map(([name, weight]) => `${name}\u00a0${Math.round(100 * weight)}\u00a0%`).join(" + ");
}
