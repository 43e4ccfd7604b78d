/** The style sheet of a page, from its parts in their order. */
import bar from "./style-bar.css";
import frame from "./style-frame.css";
import narrow from "./style-narrow.css";
import readouts from "./style-readouts.css";
import theme from "./style-theme.css";
import tiles from "./style-tiles.css";

export default [theme, frame, tiles, readouts, bar, narrow].join("\n");
