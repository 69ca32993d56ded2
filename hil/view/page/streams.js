// How the session's streams stand: opened on demand, for it is for who looks after them.

const number = (value, digits, unit) => (value === null || value === undefined ? "–" : `${value.toFixed(digits)} ${unit}`);
const element = (kind, fields) => Object.assign(document.createElement(kind), fields);

/** Of one stream, in words. */
const standing = (one) => [
  number(one.rate_hz, 1, "Hz"), `± ${number(one.bound_ms, 2, "ms")}`, `age ${number(one.age_ms, 0, "ms")}`, `drift ${number(one.drift_ppm, 1, "ppm")}`,
  `${one.resets} ${one.resets === 1 ? "reset" : "resets"}`,
].join(" · ");

/** The panel, shown with the first streams that are told of. */
export class Streams {
  constructor() {
    this.element = element("section", { className: "streams", hidden: true });
    this.list = document.createElement("ul");
    const all = document.createElement("details");
    all.append(element("summary", { textContent: "Streams" }), this.list);
    this.element.append(all);
  }

  show(streams) {
    this.element.hidden = !streams.length;
    this.list.replaceChildren(...streams.map((one) => {
      const item = element("li", { className: one.valid ? "" : "gone", title: `this computer's clock minus the stream's: ${one.offset_s.toFixed(6)} s` });
      item.append(element("b", { textContent: one.stream }), element("span", { textContent: standing(one) }));
      return item;
    }));
  }
}
