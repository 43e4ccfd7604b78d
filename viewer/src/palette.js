/** The colours of a map of numbers: viridis, as in the report's figures. */
const STOPS = [
  [68, 1, 84],
  [59, 82, 139],
  [33, 145, 140],
  [94, 201, 98],
  [253, 231, 37],
];

/** The colour of `value` between the `limits` [least, most]. */
export function colourOf(value, [least, most]) {
  const share = most > least ? Math.min(Math.max((value - least) / (most - least), 0), 1) : 0.5;
  const place = share * (STOPS.length - 1);
  const below = Math.min(Math.floor(place), STOPS.length - 2);
  const mixed = STOPS[below].map((from, part) =>
    Math.round(from + (place - below) * (STOPS[below + 1][part] - from)),
  );
  return `rgb(${mixed.join(" ")})`;
}
