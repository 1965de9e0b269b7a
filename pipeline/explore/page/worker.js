// The page without its program: questions of explore.js answered by model.js, one after another.
let model = null;

async function unpacked(text) { // base64, gzip, bytes of like weight together
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const whole = new Uint8Array(await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer());
  const count = whole.length / 4, out = new Uint8Array(whole.length);
  for (let i = 0; i < count; i++) for (let b = 0; b < 4; b++) out[4 * i + b] = whole[b * count + i];
  return new Float32Array(out.buffer);
}
function placed(value, numbers) {
  if (Array.isArray(value)) return value.map((each) => placed(each, numbers));
  if (value === null || typeof value !== "object") return value;
  if ("at" in value && "length" in value) return numbers.subarray(value.at, value.at + value.length);
  return Object.fromEntries(Object.entries(value).map(([name, each]) => [name, placed(each, numbers)]));
}
function answered(path, body) {
  if (path === "scene") return { name: model.name, limits: model.limits, design: model.design, batch: model.batch, corners: model.corners, plate: model.plate, motion: model.motion };
  if (path === "answer") return answerOf(model, body);
  if (path === "cloud") return cloudOf(model, body.first);
  const faults = faultsOf(model, body);
  if (faults.length) throw new Error(faults.join("; "));
  const every = { ...body, ...Object.fromEntries(Object.entries(model.following).map(([name, [of, ratio]]) => [name, +(ratio * body[of]).toPrecision(12)])) };
  return Object.entries(every).reduce((text, [name, value]) => text.replace(`"@${name}@"`, name === "rows" ? value.toFixed(0) : String(value)), model.case_template);
}
if (typeof self !== "undefined") self.onmessage = async ({ data: { id, path, body, document, numbers } }) => {
  try {
    if (document) { model = placed(JSON.parse(document), await unpacked(numbers)); self.postMessage({ id }); return; }
    self.postMessage({ id, found: answered(path, body) });
  } catch (fault) { self.postMessage({ id, error: fault.message }); }
};
