/** The style sheet of the page: the replay's, and what is its own. */
import replay from "../style.js";
import own from "./style-play.css";

export default `${replay}\n${own}`;
