"use strict";
// figures as pipeline/quantity.py writes them: the digits that the bar allows, frequencies in a unit that fits
const exponent = (value) => value ? Math.floor(Math.log10(Math.abs(value))) : 0;
const isKnown = (value) => typeof value === "number" && Number.isFinite(value);
function decimals(value, bar) {
  if (!isKnown(bar)) return 2 - exponent(value);
  if (bar <= 0) return 6 - exponent(value);
  const last = exponent(bar);
  return Math.min((bar / 10 ** last < 3.55 ? 1 : 0) - last, 6 - exponent(value));
}
const fixed = (value, places) => (places < 0 ? Math.round(value * 10 ** places) / 10 ** places : value).toFixed(Math.max(places, 0)).replace(/^-(?=0\.?0*$)/, "");
const SMALLEST = -4, LARGEST = 9;
function figure(value, bar) {
  if (!isKnown(value)) return "–";
  const places = decimals(value, bar), highest = exponent(value);
  if ((highest < SMALLEST || highest > LARGEST) && places + highest >= 0) return value.toExponential(places + highest).replace(/e([+-])(\d)$/, "e$10$2");
  const text = fixed(value, places);
  return isKnown(bar) && bar <= 0 && text.includes(".") ? text.replace(/\.?0+$/, "") : text;
}
const frequencyUnit = (...all) => [["GHz", 1e9], ["MHz", 1e6], ["kHz", 1e3], ["Hz", 0]].find(([, size]) => Math.max(...all) >= size);
function frequency(hz, error) {
  const [unit, size] = frequencyUnit(hz), value = hz / (size || 1);
  return error >= 1 ? "–" : `${figure(value, isKnown(error) ? value * error : null)} ${unit}`;
}
function interval(low, high, error) {
  const [unit, size] = frequencyUnit(low, high);
  const [from, to] = [low, high].map((hz) => figure(hz / (size || 1), isKnown(error) ? hz * error / (size || 1) : null));
  return `${from} to ${to} ${unit}`;
}
const level = (db, bar) => isKnown(bar) ? `${figure(db, bar)} dB` : `${fixed(db, 1)} dB`;
const ofBar = (bar, unit) => `± ${figure(bar, bar)} ${unit}`;
const frequencyBar = (hz, error) => { const [unit, size] = frequencyUnit(hz); return ofBar(hz * error / (size || 1), unit); };
const percent = (error) => `${fixed(100 * error, 1 - exponent(100 * error))} %`;
