/** Small helpers for the page's elements. Text is always set as text: names are foreign. */

/** An element with attributes ("text" is its content, "on" its listeners) and children. */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "text") made.textContent = value;
    else if (name === "on")
      Object.entries(value).forEach(([kind, f]) => made.addEventListener(kind, f));
    else if (value !== false) made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children);
  return made;
}

/** A drawing of 24 x 24 units for a button; a screen reader does not see it. */
export function icon(path) {
  const made = svg("svg", { viewBox: "0 0 24 24", "aria-hidden": "true", class: "icon" });
  made.append(svg("path", { d: path }));
  return made;
}

/** A button that shows a drawing; `label` is its name. */
export function tool(label, path, act, kind = "") {
  const attributes = { type: "button", class: `plain ${kind}`, "aria-label": label, title: label };
  return element("button", { ...attributes, on: { click: act } }, icon(path));
}

export function svg(tag, attributes = {}) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

/** Set a text where it has changed: called for every picture. */
export function write(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

export function seconds(time) {
  return `${time.toFixed(2)}\u00a0s`;
}
