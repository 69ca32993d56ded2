// The keyboard: the emergency stop before all else, then what a focused control has no use for itself.

/** Whether a focused control does something with a key of its own accord. */
function takes(target, key) {
  if (target.tagName === "SELECT") return true;
  if (target.tagName === "BUTTON" || target.type === "checkbox") return key === " ";
  return target.type === "range" && target.id !== "seek" && key.startsWith("Arrow");
}

/**
 * @param {() => (() => void) | null} stop gives the emergency stop where there is one
 * @param {() => Object<string, () => void>} keys gives what other keys do now
 */
export function listen(stop, keys) {
  const hear = (event) => {
    const pull = event.key === " " ? stop() : null;
    if (pull) {  // whatever has the focus: it neither hears of it nor presses itself as the key comes up
      event.preventDefault();
      event.stopImmediatePropagation();
      if (event.type === "keydown" && !event.repeat) pull();
      return;
    }
    if (event.type !== "keydown" || event.ctrlKey || event.metaKey || event.altKey || takes(event.target, event.key)) return;
    const act = keys()[event.key];
    if (act) { act(); event.preventDefault(); }
  };
  addEventListener("keydown", hear, { capture: true });
  addEventListener("keyup", hear, { capture: true });
  // What was pressed or dragged with a pointer does not keep the keys; who came to it by Tab does.
  // At once: a browser hands on a key that waits before it fires a timer.
  const leave = ({ target }) => { if (target.closest?.("button, input")) document.activeElement?.blur(); };
  addEventListener("pointerup", leave);
  addEventListener("click", (event) => { if (event.detail) leave(event); });
  addEventListener("change", ({ target }) => { if (target.tagName === "SELECT") target.blur(); });
}
