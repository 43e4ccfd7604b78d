/** Keys of the page. Buttons, lists and sliders keep the keys that they use themselves. */

export const KEYS = [
  ["Space, K", "play or pause"],
  ["← →", "a step back, a step on (with Shift: ten)"],
  ["Home, End", "to the start, to the end"],
  ["− +", "slower, faster"],
  ["O, D, A", "overview, follow the defender, the attacker (again: the next of the team)"],
  ["N, P", "enlarge the next or the previous fight"],
  ["Esc", "back to all fights"],
  ["S", "true or enlarged size of the drones"],
  ["0", "camera as it was at first"],
  ["T", "light or dark"],
  ["?", "this list"],
];
export const GESTURES = [
  ["Drag", "turn the view"],
  ["Wheel, pinch", "come nearer or go back"],
  ["Right or Shift drag, two fingers", "move the view"],
  ["Click or tap a fight", "enlarge it"],
];

/** Listen on `target`; `acts`: what keys do, see `page.js`. Returns a function that ends it. */
export function listen(target, acts) {
  const table = {
    " ": acts.play,
    k: acts.play,
    home: acts.start,
    end: acts.end,
    "+": acts.faster,
    "=": acts.faster,
    "-": acts.slower,
    o: () => acts.follow(null),
    d: () => acts.follow(0),
    a: () => acts.follow(1),
    n: acts.next,
    p: acts.previous,
    escape: acts.all,
    s: acts.toggleSize,
    0: acts.resetView,
    t: acts.theme,
    "?": acts.help,
  };
  const press = (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
    const on = event.composedPath()[0];
    if (keeps(on, event.key)) return;
    const act = step(event, acts) ?? table[event.key.toLowerCase()];
    if (!act) return;
    event.preventDefault();
    event.stopPropagation(); // a notebook has keys of its own
    act();
  };
  target.addEventListener("keydown", press);
  return () => target.removeEventListener("keydown", press);
}

function step({ key, shiftKey }, acts) {
  const by = { ArrowLeft: -1, ArrowRight: 1 }[key];
  return by === undefined ? undefined : () => acts.step(by * (shiftKey ? 10 : 1));
}

/** Whether the element that has the focus uses this key itself. */
function keeps(node, key) {
  if (!(node instanceof Element)) return false;
  if (node.closest("dialog")) return true;
  if (node.matches("select, textarea, input:not([type=range]):not([type=checkbox])")) return true;
  if (node.matches("button, input[type=checkbox]")) return key === " " || key === "Enter";
  return false;
}
