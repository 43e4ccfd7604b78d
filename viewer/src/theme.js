/** Light and dark: as the notebook or the system wants it, until somebody switches. */

const DARK = "(prefers-color-scheme: dark)";

export class Theme {
  /** `host` gets `data-theme`; `onChange` is called after every change. */
  constructor(host, onChange) {
    this.host = host;
    this.onChange = onChange;
    this.chosen = null;
    this.query = window.matchMedia(DARK);
    this.follow = () => this.apply();
    this.query.addEventListener("change", this.follow);
    this.apply();
  }

  get dark() {
    return (this.chosen ?? surroundings() ?? (this.query.matches ? "dark" : "light")) === "dark";
  }

  toggle() {
    this.chosen = this.dark ? "light" : "dark";
    this.apply();
  }

  apply() {
    this.host.dataset.theme = this.dark ? "dark" : "light";
    this.onChange();
  }

  /** The colour that the style sheet gives the name now. */
  colour(name) {
    return getComputedStyle(this.host).getPropertyValue(`--${name}`).trim();
  }

  dispose() {
    this.query.removeEventListener("change", this.follow);
  }
}

/** The theme of JupyterLab or VS Code, which need not be the system's; undefined elsewhere. */
function surroundings() {
  const { classList, dataset } = document.body;
  if (dataset.jpThemeLight) return dataset.jpThemeLight === "true" ? "light" : "dark";
  if (classList.contains("vscode-dark") || classList.contains("vscode-high-contrast"))
    return "dark";
  return classList.contains("vscode-light") ? "light" : undefined;
}
