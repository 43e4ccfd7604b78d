/** A policy network from the page's data: observation to mean action. */

/** `raw`: of `report/play_data.py`; returns `policy(observation) -> action` of plain numbers. */
export function buildPolicy({ sizes, clip, normalize, numbers }) {
  const all = floats(numbers);
  let from = 0;
  const take = (count) => all.subarray(from, (from += count));
  const [mean, spread] = [take(sizes[0]), take(sizes[0])];
  const layers = sizes
    .slice(1)
    .map((wide, i) => ({ weight: take(sizes[i] * wide), bias: take(wide) }));
  if (from !== all.length) throw new Error("the policy's numbers do not fit its layers");
  return (observation) => {
    let x = observation;
    if (normalize) {
      const bounded = (value) => Math.min(Math.max(value, -clip), clip);
      x = observation.map((value, i) => bounded((value - mean[i]) / spread[i]));
    }
    layers.forEach((layer, index) => {
      x = affine(layer, x);
      if (index < layers.length - 1) x = x.map((value) => (value > 0 ? value : Math.expm1(value)));
    });
    return [...x];
  };
}

/** `weight` [in, out], row by row. */
function affine({ weight, bias }, x) {
  const out = Float64Array.from(bias);
  const wide = out.length;
  for (let i = 0; i < x.length; i += 1) {
    for (let j = 0; j < wide; j += 1) out[j] += x[i] * weight[i * wide + j];
  }
  return out;
}

/** Base64 of little-endian float32. */
function floats(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  return Float32Array.from({ length: bytes.length / 4 }, (_, i) => view.getFloat32(4 * i, true));
}
