/** What is written over the picture in each phase. */

const TASK = [
  ["Defend the target", "Catch the attacker in your blue bubble before it reaches the green mark."],
  ["Reach the target", "Fly into the green mark before the defender's blue bubble catches you."],
];

/** {large, small, button, winner}; an empty `large`: nothing is written. */
export function banner(session) {
  const { phase, person, end } = session;
  const nothing = { large: "", small: "", button: "", winner: "" };
  if (phase === "counting") return { ...nothing, large: String(session.count) };
  if (phase === "paused") return { ...nothing, large: "Paused", small: "", button: "Go on" };
  if (phase === "ready") {
    const [large, small] = TASK[person];
    return { ...nothing, large, small: `${small} ${HANDS}`, button: "Start" };
  }
  if (phase !== "over") return nothing;
  const own = ["defender", "attacker"][person];
  const result = end.winner === own ? "You win" : end.winner === "nobody" ? "A tie" : "You lose";
  const small = `${end.sentence} after ${session.time.toFixed(2)}\u00a0s.`;
  return { large: result, small, button: "Again", winner: end.winner };
}

const HANDS = matchMedia("(pointer: coarse)").matches
  ? "Drag on the left to fly, on the right to climb."
  : "W A S D fly, space climbs, shift sinks; hands off, you hover.";
