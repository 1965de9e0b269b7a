"use strict";
// Decompression of embedded data: text, and rows of integers stored by component, low bytes first.
const unpack = (() => {
  async function bytes(text) {
    const raw = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    const inflated = new Blob([raw]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(inflated).arrayBuffer());
  }
  async function rows(text, columns, size, signed = false) {
    const raw = await bytes(text), count = raw.length / size, each = count / columns, span = 2 ** (8 * size);
    const found = new Float64Array(count);
    for (let i = 0; i < count; i++) {
      let value = 0;
      for (let plane = 0; plane < size; plane++) value += raw[plane * count + i] * 2 ** (8 * plane);
      found[(i % each) * columns + Math.floor(i / each)] = signed && value >= span / 2 ? value - span : value;
    }
    return found;
  }
  return { rows, text: async (text) => new TextDecoder().decode(await bytes(text)) };
})();
