/** The page's frame: header, pictures, read-outs and bar, and the list of keys. */
import { element, tool } from "./dom.js";
import { ENLARGEMENT } from "./drone.js";
import { GESTURES, KEYS } from "./keyboard.js";

const ICONS = {
  theme: "M12 3a9 9 0 1 0 0 18V3zm0-2a11 11 0 1 1 0 22 11 11 0 0 1 0-22z",
  help:
    "M11 17h2v2h-2zm1-12a4 4 0 0 0-4 4h2a2 2 0 1 1 3.3 1.5C12 11.6 11 12.4 11 15h2" +
    "c0-1.8.8-2.2 2-3.2A4 4 0 0 0 12 5z",
};
export const NO_WEBGL =
  "This browser gives no WebGL, so the fights cannot be drawn here. Switch hardware acceleration " +
  "on, or open the page in another browser. Results and numbers are below all the same.";
export const LOST =
  "The browser has taken the graphics away from this page. Load it again to see the fights.";

/** Build the frame; `parts`: the elements of tiles, read-outs, timeline and controls. */
export function frame(data, parts, acts) {
  const tally = element("p", { class: "tally" });
  const header = element(
    "header",
    {},
    element(
      "div",
      { class: "titles" },
      element("h1", { text: data.title }),
      element("p", { class: "about", text: data.about }),
    ),
    tally,
    tool("Light or dark", ICONS.theme, acts.theme),
    tool("Keys and gestures", ICONS.help, acts.help),
  );
  const canvas = element("canvas", { "aria-hidden": "true" });
  const message = element("p", { class: "message", role: "alert", hidden: true });
  const size = element("p", {
    class: "size",
    text: `drones drawn ${ENLARGEMENT} times their size`,
  });
  const stage = element("div", { class: "stage" }, canvas, parts.tiles, size, message);
  const main = element("main", {}, stage, parts.readouts);
  const footer = element("footer", {}, parts.timeline, parts.controls);
  const help = helpDialog();
  const root = element("div", { class: "replay" }, header, main, footer, help);
  return { root, canvas, message, tally, size, help };
}

/** The results as a list, where no picture is; `onOpen(index)`: a fight's numbers are wanted. */
export function resultList(flights, onOpen) {
  const row = ({ name, result }, index) => {
    const open = element("button", {
      type: "button",
      text: name,
      on: { click: () => onOpen(index) },
    });
    return element("li", {}, open, element("span", { text: result.sentence }));
  };
  return element("ul", { class: "results" }, ...flights.map(row));
}

function helpDialog() {
  const rows = [...KEYS, ...GESTURES].map(([key, meaning]) =>
    element("tr", {}, element("th", { scope: "row", text: key }), element("td", { text: meaning })),
  );
  const close = element("button", { type: "button", class: "close", text: "Close" });
  const dialog = element(
    "dialog",
    { "aria-label": "Keys and gestures" },
    element("h2", { text: "Keys and gestures" }),
    element("table", {}, element("tbody", {}, ...rows)),
    close,
  );
  close.addEventListener("click", () => dialog.close());
  return dialog;
}
