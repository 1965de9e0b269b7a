// The solver of an exported page: a design's reduced cell, its bands, the waves of its column and the plate made of them.
// Constants, rules, words, polynomials and the cloud's designs are data that pipeline/explore/offline.py writes.
"use strict";
const zeros = (n) => new Float64Array(n);

// dense matrices: { n rows, m columns, a row by row }
const mat = (n, m) => ({ n, m, a: zeros(n * m) });
function mul(x, y, first = 0) { // row i from column first * i on; four terms at a time, two rows at a time: an answer is mostly such sums
  const { n, m: inner, a } = x, w = y.m, b = y.a, out = mat(n, w), o = out.a;
  let k = 0;
  for (; k + 3 < inner; k += 4) {
    const q = k * w, r = q + w, s = r + w, t = s + w;
    let i = 0;
    for (; i + 1 < n; i += 2) {
      const at = i * inner + k, on = at + inner, v0 = a[at], v1 = a[at + 1], v2 = a[at + 2], v3 = a[at + 3], u0 = a[on], u1 = a[on + 1], u2 = a[on + 2], u3 = a[on + 3];
      if (v0 || v1 || v2 || v3 || u0 || u1 || u2 || u3)
        for (let j = first * i, p = i * w, l = p + w; j < w; j++) {
          const b0 = b[q + j], b1 = b[r + j], b2 = b[s + j], b3 = b[t + j];
          o[p + j] += v0 * b0 + v1 * b1 + v2 * b2 + v3 * b3;
          o[l + j] += u0 * b0 + u1 * b1 + u2 * b2 + u3 * b3;
        }
    }
    if (i < n) {
      const at = i * inner + k, v0 = a[at], v1 = a[at + 1], v2 = a[at + 2], v3 = a[at + 3];
      for (let j = first * i, p = i * w; j < w; j++) o[p + j] += v0 * b[q + j] + v1 * b[r + j] + v2 * b[s + j] + v3 * b[t + j];
    }
  }
  for (; k < inner; k++)
    for (let i = 0; i < n; i++) {
      const v = a[i * inner + k];
      if (v) for (let j = first * i, p = i * w, q = k * w; j < w; j++) o[p + j] += v * b[q + j];
    }
  return out;
}
const mulT = (x, y, first) => mul(transposed(x), y, first); // x' y
function congruent(x, t) { // t' x t of a symmetric matrix: its upper half alone is summed
  const out = mulT(t, mul(x, t), 1), n = t.m;
  for (let i = 0; i < n; i++) for (let j = 0; j < i; j++) out.a[i * n + j] = out.a[j * n + i];
  return out;
}
function transposed(x) {
  const out = mat(x.m, x.n);
  for (let i = 0; i < x.n; i++) for (let j = 0; j < x.m; j++) out.a[j * x.n + i] = x.a[i * x.m + j];
  return out;
}
function block(x, r0, r1, c0, c1) {
  const out = mat(r1 - r0, c1 - c0);
  for (let i = r0; i < r1; i++) out.a.set(x.a.subarray(i * x.m + c0, i * x.m + c1), (i - r0) * out.m);
  return out;
}
function picked(x, rows, columns) {
  const out = mat(rows.length, columns.length);
  rows.forEach((r, i) => columns.forEach((c, j) => { out.a[i * out.m + j] = x.a[r * x.m + c]; }));
  return out;
}
function plus(x, y, factor = 1) {
  const out = mat(x.n, x.m);
  for (let i = 0; i < out.a.length; i++) out.a[i] = x.a[i] + factor * y.a[i];
  return out;
}
function beside(x, y) {
  const out = mat(x.n, x.m + y.m);
  for (let i = 0; i < x.n; i++) {
    out.a.set(x.a.subarray(i * x.m, (i + 1) * x.m), i * out.m);
    out.a.set(y.a.subarray(i * y.m, (i + 1) * y.m), i * out.m + x.m);
  }
  return out;
}
const below = (x, y) => { const out = mat(x.n + y.n, x.m); out.a.set(x.a); out.a.set(y.a, x.a.length); return out; };
const scaledColumns = (x, factors) => { const out = mat(x.n, x.m); for (let i = 0; i < x.a.length; i++) out.a[i] = x.a[i] * factors[i % x.m]; return out; };
const range = (low, high) => Array.from({ length: high - low }, (_, i) => low + i);

function cholesky(x) { // lower factor, null where x is not positive
  const n = x.n, l = mat(n, n);
  for (let i = 0; i < n; i++)
    for (let j = 0; j <= i; j++) {
      let v = x.a[i * n + j];
      for (let k = 0, p = i * n, q = j * n; k < j; k++) v -= l.a[p + k] * l.a[q + k];
      if (i > j) l.a[i * n + j] = v / l.a[j * n + j];
      else if (v > 0) l.a[i * n + i] = Math.sqrt(v);
      else return null;
    }
  return l;
}
function forward(l, x) { // L^-1 x
  const out = mat(x.n, x.m), w = x.m, n = l.n;
  out.a.set(x.a);
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < i; k++) {
      const v = l.a[i * n + k];
      if (v) for (let j = 0, p = i * w, q = k * w; j < w; j++) out.a[p + j] -= v * out.a[q + j];
    }
    const d = 1 / l.a[i * n + i];
    for (let j = 0, p = i * w; j < w; j++) out.a[p + j] *= d;
  }
  return out;
}
function backward(l, x) { // L'^-1 x
  const out = mat(x.n, x.m), w = x.m, n = l.n;
  out.a.set(x.a);
  for (let i = n - 1; i >= 0; i--) {
    const d = 1 / l.a[i * n + i];
    for (let j = 0, p = i * w; j < w; j++) out.a[p + j] *= d;
    for (let k = 0; k < i; k++) {
      const v = l.a[i * n + k];
      if (v) for (let j = 0, p = k * w, q = i * w; j < w; j++) out.a[p + j] -= v * out.a[q + j];
    }
  }
  return out;
}
const solved = (l, x) => backward(l, forward(l, x));

// symmetric eigenvalues: Householder to tridiagonal form, then implicit QL (EISPACK tred2, tql2)
function symmetricEigen(x, withVectors) {
  const n = x.n, z = x.a.slice(), d = zeros(n), e = zeros(n);
  for (let i = n - 1; i > 0; i--) {
    let scale = 0, h = 0;
    const row = i * n;
    for (let k = 0; k < i; k++) scale += Math.abs(z[row + k]);
    if (i === 1 || scale === 0) { e[i] = z[row + i - 1]; d[i] = 0; continue; }
    for (let k = 0; k < i; k++) { z[row + k] /= scale; h += z[row + k] * z[row + k]; }
    let f = z[row + i - 1], g = f >= 0 ? -Math.sqrt(h) : Math.sqrt(h);
    e[i] = scale * g; h -= f * g; z[row + i - 1] = f - g; f = 0;
    for (let j = 0; j < i; j++) e[j] = 0;
    for (let j = 0; j < i; j++) { // e = A u by the lower triangle
      const u = z[row + j], at = j * n;
      let s = z[at + j] * u;
      for (let k = 0; k < j; k++) { s += z[at + k] * z[row + k]; e[k] += z[at + k] * u; }
      e[j] += s;
    }
    for (let j = 0; j < i; j++) { if (withVectors) z[j * n + i] = z[row + j] / h; e[j] /= h; f += e[j] * z[row + j]; }
    const hh = f / (h + h);
    for (let j = 0; j < i; j++) e[j] -= hh * z[row + j];
    for (let j = 0; j < i; j++) {
      const u = z[row + j], v = e[j], at = j * n;
      for (let k = 0; k <= j; k++) z[at + k] -= u * e[k] + v * z[row + k];
    }
    d[i] = h;
  }
  d[0] = 0; e[0] = 0;
  const work = zeros(n);
  for (let i = 0; i < n; i++) {
    if (!withVectors) { d[i] = z[i * n + i]; continue; }
    if (d[i] !== 0) {
      work.fill(0, 0, i);
      for (let k = 0; k < i; k++) { const v = z[i * n + k]; for (let j = 0, p = k * n; j < i; j++) work[j] += v * z[p + j]; }
      for (let k = 0; k < i; k++) { const v = z[k * n + i]; for (let j = 0, p = k * n; j < i; j++) z[p + j] -= work[j] * v; }
    }
    d[i] = z[i * n + i]; z[i * n + i] = 1;
    for (let j = 0; j < i; j++) z[j * n + i] = z[i * n + j] = 0;
  }
  const t = withVectors ? transposed({ n, m: n, a: z }).a : null; // a vector a row: rotations run along memory
  ql(d, e, t, n);
  const order = range(0, n).sort((a, b) => d[a] - d[b]);
  const vectors = withVectors ? mat(n, n) : null;
  if (vectors) order.forEach((from, to) => { for (let i = 0; i < n; i++) vectors.a[i * n + to] = t[from * n + i]; });
  return { values: Float64Array.from(order, (i) => d[i]), vectors };
}
function ql(d, e, t, n) {
  for (let i = 1; i < n; i++) e[i - 1] = e[i];
  e[n - 1] = 0;
  for (let l = 0; l < n; l++)
    for (let turn = 0; turn < 100; turn++) {
      let m = l;
      while (m < n - 1 && Math.abs(e[m]) > 2.3e-16 * (Math.abs(d[m]) + Math.abs(d[m + 1]))) m++;
      if (m === l) break;
      let g = (d[l + 1] - d[l]) / (2 * e[l]), r = Math.hypot(g, 1);
      g = d[m] - d[l] + e[l] / (g + (g >= 0 ? r : -r));
      let s = 1, c = 1, p = 0, i = m - 1;
      for (; i >= l; i--) {
        let f = s * e[i];
        const b = c * e[i];
        r = Math.sqrt(f * f + g * g); e[i + 1] = r;
        if (r === 0) { d[i + 1] -= p; e[m] = 0; break; }
        s = f / r; c = g / r; g = d[i + 1] - p; r = (d[i] - g) * s + 2 * c * b; p = s * r;
        d[i + 1] = g + p; g = c * r - b;
        if (t) for (let k = 0, x = i * n, y = (i + 1) * n; k < n; k++) { f = t[y + k]; t[y + k] = s * t[x + k] + c * f; t[x + k] = c * t[x + k] - s * f; }
      }
      if (r === 0 && i >= l) continue;
      d[l] -= p; e[l] = g; e[m] = 0;
    }
}
function symmetricPencil(k, m, withVectors) {
  const l = cholesky(m);
  if (!l) throw new Error("a mass matrix is not positive: the design lies at the end of what the bases follow");
  const { values, vectors } = symmetricEigen(forward(l, transposed(forward(l, k))), withVectors);
  return { values, vectors: vectors && backward(l, vectors) };
}
const firstColumns = (x, count) => block(x, 0, x.n, 0, count);

// ---- the cell at a design: solvers/parametric/cell.py ----
function theta(data, exponents, sizes) {
  const [x, y] = data.box.panel, { reach } = data.foot, stretch = ([t, h, a, p]) => [t, h, a, x * p - reach * a, y * p - reach * a, p], now = stretch(sizes), then = stretch(data.reference);
  return exponents.map((row) => row.reduce((v, power, axis) => v * (now[axis] / then[axis]) ** power, 1));
}
function summed(triangles, weights, n) {
  const half = n * (n + 1) / 2, line = zeros(half), out = mat(n, n);
  weights.forEach((w, q) => { for (let i = 0, s = q * half; i < half; i++) line[i] += w * triangles[s + i]; });
  for (let i = 0, at = 0; i < n; i++) for (let j = i; j < n; j++, at++) out.a[i * n + j] = out.a[j * n + i] = line[at];
  return out;
}
const lagrange = (places, x) => places.map((at, s) => places.reduce((v, other, o) => o === s ? v : v * (x - other) / (at - other), 1));
function boundaryAt(own, share) { // polynomials of the ratio of the block's width to the pitch
  const f = own.functions, m = own.parity_count, out = mat(f, m);
  lagrange(own.shares, share).forEach((w, s) => { for (let i = 0; i < f * m; i++) out.a[i] += w * own.coordinates[s * f * m + i]; });
  return out;
}
function lowestModes(k, factor, m, count) { // inverse iteration of a few vectors more than asked for
  const n = k.n, width = 2 * count + 4;
  if (n < 4 * width) { const all = symmetricPencil(k, m, true); return { values: all.values.slice(0, count), modes: firstColumns(all.vectors, count) }; }
  let x = mat(n, width), values = null, before = null;
  for (let i = 0, seed = 1; i < x.a.length; i++) { seed = seed * 16807 % 2147483647; x.a[i] = seed / 2147483647 - 0.5; }
  for (let turn = 0; turn < 60; turn++) {
    const y = solved(factor, mul(m, x)), small = symmetricPencil(congruent(k, y), congruent(m, y), true);
    x = mul(y, small.vectors); values = small.values;
    if (before && range(0, count).every((i) => Math.abs(values[i] - before[i]) <= 1e-11 * values[i])) break;
    before = values;
  }
  return { values: values.slice(0, count), modes: firstColumns(x, count) };
}
function prepared(data, sizes, modes = data.bands_inner.modes, blocks = data.blocks) { // what both uses of a design share: matrices of every class, its inside factorised
  return blocks.map((own) => {
    const [tk, tm] = [own.stiffness_exponents, own.mass_exponents].map((rows) => theta(data, rows, sizes)), n = own.size, f = own.functions, k = summed(own.stiffness, tk, n), m = summed(own.mass, tm, n);
    const inner = { k: block(k, f, n, f, n), m: block(m, f, n, f, n) }, factor = cholesky(inner.k);
    const lowest = lowestModes(inner.k, factor, inner.m, modes);
    return { own, f, n, k, m, inner, factor, lowest, beside: data.constants.beside, boundary: boundaryAt(own, data.foot.reach * sizes[2] / (data.box.narrow * sizes[3])) };
  });
}
function rigidSpan(rigid, ratio) { // orthonormal columns, by Gram and Schmidt
  const out = [];
  for (let c = 0; c < 6; c++) {
    const v = Float64Array.from(rigid.still, (row, i) => row[c] + ratio * rigid.thick[i][c]);
    for (let again = 0; again < 2; again++)
      for (const u of out) { const s = u.reduce((t, x, i) => t + x * v[i], 0); for (let i = 0; i < v.length; i++) v[i] -= s * u[i]; }
    const length = Math.hypot(...v);
    if (length > 1e-9) out.push(v.map((x) => x / length));
  }
  return out;
}
function flexible(k, span) {
  const out = mat(k.n, k.m), pi = mat(k.n, k.n);
  for (let i = 0; i < k.n; i++) pi.a[i * k.n + i] = 1;
  for (const u of span) for (let i = 0; i < k.n; i++) for (let j = 0; j < k.n; j++) pi.a[i * k.n + j] -= u[i] * u[j];
  out.a.set(mul(pi, mul(k, pi)).a);
  return out;
}
function classAt(one, sizes, use, counts, withTouch) {
  const { own, f, n, k, m, inner, factor } = one, p = picked(one.boundary, range(0, f), use.kept), width = p.m;
  const kib = block(k, f, n, 0, f), mib = block(m, f, n, 0, f), si = solved(factor, mul(kib, p));
  for (let i = 0; i < si.a.length; i++) si.a[i] = -si.a[i];
  const pushed = plus(mul(mib, p), mul(inner.m, si)), answer = solved(factor, pushed);
  const values = one.lowest.values.slice(0, counts.modes), modes = firstColumns(one.lowest.modes, counts.modes);
  const left = plus(answer, mul(scaledColumns(modes, values.map((v) => 1 / v)), mulT(modes, pushed)), -1);
  const kbb = plus(congruent(block(k, 0, f, 0, f), p), mulT(mul(kib, p), si));
  const mbb = plus(plus(congruent(block(m, 0, f, 0, f), p), mulT(mul(mib, p), si)), mulT(si, pushed));
  const lost = mulT(pushed, left), energy = plus(kbb, mbb, one.beside);
  const along = symmetricPencil(halfSum(lost), halfSum(energy), true).vectors;
  const more = mul(left, block(along, 0, width, width - counts.residual, width));
  const turn = symmetricPencil(congruent(inner.k, more), congruent(inner.m, more), true);
  const inside = beside(modes, mul(more, turn.vectors)), every = [...values, ...turn.values];
  const coupling = mulT(pushed, inside);
  const rest = plus(mulT(pushed, answer), mul(scaledColumns(coupling, every.map((v) => 1 / v)), transposed(coupling)), -1);
  const shapes = below(beside(p, mat(f, inside.m)), beside(si, inside));
  const out = { k: flexible(halfSum(kbb), rigidSpan(use.rigid, sizes[0] / sizes[3])), m: halfSum(mbb), coupling, values: every, lost: rest, last: values[values.length - 1], width, shapes };
  if (withTouch) out.touch = mul({ n: own.touch.length / n, m: n, a: own.touch }, shapes);
  return out;
}
const halfSum = (x) => { const out = mat(x.n, x.n); for (let i = 0; i < x.n; i++) for (let j = 0; j < x.n; j++) out.a[i * x.n + j] = (x.a[i * x.n + j] + x.a[j * x.n + i]) / 2; return out; };

// ---- bands: solvers/parametric/bands.py ----
function pencil(parts, basis) {
  const free = basis.m, inner = parts.reduce((n, part) => n + part.values.length, 0), n = free + inner, k = mat(n, n), m = mat(n, n);
  let row = 0, start = free;
  for (const part of parts) {
    const own = block(basis, row, row + part.width, 0, free), kf = congruent(part.k, own), mf = congruent(part.m, own), c = mulT(own, part.coupling);
    for (let i = 0; i < free; i++) {
      for (let j = 0; j < free; j++) { k.a[i * n + j] += kf.a[i * free + j]; m.a[i * n + j] += mf.a[i * free + j]; }
      for (let j = 0; j < c.m; j++) m.a[i * n + start + j] = m.a[(start + j) * n + i] = c.a[i * c.m + j];
    }
    part.values.forEach((v, i) => { k.a[(start + i) * (n + 1)] = v; m.a[(start + i) * (n + 1)] = 1; });
    row += part.width; start += part.values.length;
  }
  return { k, m, free };
}
function basisOf(sector, at) { const size = sector.rows * sector.width; return { n: sector.rows, m: sector.width, a: sector.bases.subarray(at * size, (at + 1) * size) }; }
function merged(points, count, found) { // every sector's waves at each wavevector, by their eigenvalues
  const out = range(0, points).map(() => []);
  for (const [point, waves] of found) out[point].push(...waves);
  return out.map((waves) => waves.sort((a, b) => a.value - b.value).slice(0, count));
}
function pillarForm(data, one, part, sizes) { // of a wave's kinetic energy in the pillar, whose share alone goes with the height
  const weights = theta(data, one.own.mass_exponents, sizes).map((w, q) => one.own.mass_exponents[q][1] ? w : 0);
  return congruent(summed(one.own.mass, weights, one.n), part.shapes);
}
function energies(total, form, x) { // adds x' form x of every column
  const y = mul(form, x);
  for (let i = 0; i < y.a.length; i++) total[i % y.m] += x.a[i] * y.a[i];
}
function wavesOf(data, parts, sector, at, number) { // with their shares in pillar and bending: solvers/waves/branches.py
  const own = sector.classes.map((c) => parts[c]), basis = basisOf(sector, at), { k, m, free } = pencil(own, basis), { values, vectors } = symmetricPencil(k, m, true);
  const count = Math.min(data.count, values.length), waves = firstColumns(vectors, count), edges = mul(basis, block(waves, 0, free, 0, count)), [pillar, out, whole] = range(0, 3).map(() => zeros(count));
  let row = 0, start = free;
  for (const part of own) {
    const edge = block(edges, row, row += part.width, 0, count);
    energies(pillar, part.pillar, below(edge, block(waves, start, start += part.values.length, 0, count)));
    energies(out, part.lines.out, edge); energies(whole, part.lines.whole, edge);
  }
  return range(0, count).map((c) => ({ value: values[c], sector: number, pillar: Math.min(Math.max(pillar[c], 0), 1), flexural: out[c] / Math.max(whole[c], Number.MIN_VALUE) }));
}
function corrected(parts, basis, count) { // less what the inner functions left out take, to first order
  const { k, m, free } = pencil(parts, basis), { values, vectors } = symmetricPencil(k, m, true);
  return range(0, Math.min(count, values.length)).map((c) => {
    let taken = 0, row = 0;
    for (const part of parts) {
      const piece = zeros(part.width);
      for (let i = 0; i < part.width; i++) for (let j = 0; j < free; j++) piece[i] += basis.a[(row + i) * free + j] * vectors.a[j * vectors.m + c];
      for (let i = 0; i < part.width; i++) for (let j = 0; j < part.width; j++) taken += piece[i] * part.lost.a[i * part.width + j] * piece[j];
      row += part.width;
    }
    return { value: values[c] - values[c] ** 2 * taken };
  });
}
function bandsOf(data, ready, sizes) {
  const parts = ready.map((one, number) => classAt(one, sizes, data.blocks[number].whole, data.bands_inner, false)), points = data.fractions.length;
  parts.forEach((part, number) => { const { out, whole } = data.blocks[number].lines, n = part.width; Object.assign(part, { pillar: pillarForm(data, ready[number], part, sizes), lines: { out: { n, m: n, a: out }, whole: { n, m: n, a: whole } } }); });
  const { flat, safety, smallest } = data.constants, found = [], better = [];
  data.sectors.forEach((sector, number) => sector.points.forEach((point, at) => found.push([point, wavesOf(data, parts, sector, at, number)])));
  for (const sector of data.rich) {
    const own = sector.classes.map((c) => parts[c]);
    sector.points.forEach((point, at) => better.push([point, corrected(own, basisOf(sector, at), data.count)]));
  }
  const ours = merged(points, data.count, found), theirs = merged(points, data.count, better), excess = zeros(data.count);
  theirs.forEach((row, i) => {
    if (row.length < data.count) return;
    row.forEach(({ value: v }, band) => { if (v > flat ** 2 * row[row.length - 1].value) excess[band] = Math.max(excess[band], 0.5 * Math.abs(ours[i][band].value / v - 1)); });
  });
  const error = Array.from(excess, (v, i) => safety * Math.max(v, excess[i + 1] || 0, excess[i - 1] || 0) + data.floor);
  const high = data.mesh ? betweenCorners(data, data.mesh.high, sizes) : zeros(data.count);
  const sorted = ours.map((row) => row.map((wave, band) => ({ ...wave, rests: wave.value <= flat ** 2 * row[row.length - 1].value, hz: Math.sqrt(Math.max(wave.value, 0)) * data.angular / (2 * Math.PI) / (1 + high[band]) })).sort((a, b) => a.hz - b.hz));
  const table = (of) => sorted.map((row) => row.map(of)), frequency = table((wave) => wave.hz), share = (name) => table((wave) => wave.rests ? null : wave[name]);
  const mesh = data.mesh ? betweenCorners(data, data.mesh.corners, sizes).map((v) => data.mesh.margin * v) : null;
  return { frequency_hz: frequency, sector: table((wave) => wave.sector), pillar: share("pillar"), flexural: share("flexural"), error, mesh_error: mesh, as_meshed: mesh && mesh.map((v, band) => v + high[band]), labels: data.labels, gaps: gapsOf(frequency, error, mesh, smallest) };
}
function unitOf(data, sizes) { // solvers/parametric/affine.py
  const box = data.box, unit = sizes.map((v, i) => Math.log(v / box.low[i]) / Math.log(box.high[i] / box.low[i])), side = data.foot.widest * sizes[2] / box.narrow, least = Math.max(box.low[3] - side, box.clearance / box.narrow);
  unit[3] = Math.log((sizes[3] - side) / least) / Math.log((box.high[3] - side) / least);
  return unit.map((u) => Math.min(Math.max(u, 0), 1));
}
function betweenCorners(data, corners, sizes) { // pipeline/models/parametric.py: logarithms in the box's corners
  const unit = unitOf(data, sizes), total = zeros(corners[0].length);
  corners.forEach((row, corner) => {
    const weight = unit.reduce((w, u, i) => w * (corner >> 3 - i & 1 ? u : 1 - u), 1);
    row.forEach((log, band) => { total[band] += weight * log; });
  });
  return Array.from(total, Math.exp);
}
function meshAt(found, hz) { // of the bands that reach down to a frequency; a column stands as its cells are meshed
  if (!found.as_meshed) return 0;
  return Math.max(0, ...found.as_meshed.filter((_, band) => Math.min(...found.frequency_hz.map((row) => row[band])) <= hz));
}
function gapsOf(table, error, mesh, smallest) {
  const out = [];
  for (let band = 0; band + 1 < table[0].length; band++) {
    const top = Math.max(...table.map((row) => row[band])), bottom = Math.min(...table.map((row) => row[band + 1]));
    if (bottom - top > smallest * bottom)
      out.push({ lower_hz: top, upper_hz: bottom, lower_band: band + 1, upper_band: band + 2, error: mesh === null ? null : Math.max(error[band] + mesh[band], error[band + 1] + mesh[band + 1]) });
  }
  return out;
}

// ---- cells of rows and column, among boundary functions and what lies inside: real, in units of the thickness ----
const pillarBlocks = (data, blocks) => blocks.slice(0, data.blocks.length / data.box.panels); // a bare panel's come last
function joinedCell(data, ready, sizes) {
  const face = data.face, b = face.count, counts = data.face_inner;
  const stored = pillarBlocks(data, ready).map((one, number) => classAt(one, sizes, data.blocks[number].low, counts, true));
  const parts = stored.map((part, number) => ({ ...part, parity: data.blocks[number].low.parity, signs: data.blocks[number].signs }));
  const last = parts[parts.length - 1];
  if (data.box.is_alike) parts.push({ ...last, signs: [last.signs[1], last.signs[0]], parity: picked(last.parity, face.diagonal, range(0, last.parity.m)),
    touch: picked(last.touch, data.turned, range(0, last.touch.m)) });
  const each = counts.modes + counts.residual, n = b + parts.length * each, k = mat(n, n), m = mat(n, n), dropped = mat(b, b), ratio = data.reference[0] / sizes[0];
  const touch = mat(4 * data.touch_m.length, n), images = [[1, 1], [1, -1], [-1, 1], [-1, -1]];
  parts.forEach((part, number) => {
    const start = b + number * each, kb = mul(part.parity, mul(part.k, transposed(part.parity))), mb = mul(part.parity, mul(part.m, transposed(part.parity)));
    const c = mul(part.parity, part.coupling), lost = mul(part.parity, mul(part.lost, transposed(part.parity)));
    for (let i = 0; i < b * b; i++) dropped.a[i] += 4 * ratio ** 5 * lost.a[i];
    for (let i = 0; i < b; i++) {
      for (let j = 0; j < b; j++) { k.a[i * n + j] += 4 * ratio * kb.a[i * b + j]; m.a[i * n + j] += 4 * ratio ** 3 * mb.a[i * b + j]; }
      for (let j = 0; j < each; j++) m.a[i * n + start + j] = m.a[(start + j) * n + i] = 4 * ratio ** 3 * c.a[i * each + j];
    }
    part.values.forEach((v, i) => { k.a[(start + i) * (n + 1)] = 4 * ratio * v; m.a[(start + i) * (n + 1)] = 4 * ratio ** 3; });
    const polynomials = mul(block(part.touch, 0, part.touch.n, 0, part.width), transposed(part.parity));
    images.forEach((image, q) => {
      const flip = (image[0] < 0 ? part.signs[0] : 1) * (image[1] < 0 ? part.signs[1] : 1);
      for (let i = 0; i < part.touch.n; i++) {
        const at = (q * part.touch.n + i) * n;
        for (let j = 0; j < b; j++) touch.a[at + j] += flip * polynomials.a[i * b + j];
        for (let j = 0; j < each; j++) touch.a[at + start + j] += flip * part.touch.a[i * part.touch.m + part.width + j];
      }
    });
  });
  const odd = parts.flatMap((part) => Array(each).fill(part.signs[0] < 0));
  return { k, m, dropped, edge: Math.min(...parts.map((part) => part.last)) / ratio ** 2, odd, width: sizes[3] * data.box.panel[0], ...touchPlaces(data, sizes, images), touch };
}
function touchPlaces(data, sizes, images) {
  const { reach } = data.foot, a0 = reach * data.reference[2] / 2, a = reach * sizes[2] / 2, ends = data.box.panel.map((side) => [side * data.reference[3] / 2, side * sizes[3] / 2]);
  const beyond = ends.map(([p0, p]) => (p - a) / (p0 - a0)), moved = (v, axis) => v < a0 ? v * a / a0 : a + (v - a0) * beyond[axis], stretch = (v, axis) => v < a0 ? a / a0 : beyond[axis];
  const points = images.flatMap(([x, y]) => data.touch_m.map((at) => [x * moved(at[0], 0), y * moved(at[1], 1)]));
  const own = data.touch_m.map((at, i) => data.touch_weights[i] * stretch(at[0], 0) * stretch(at[1], 1));
  return { points, weights: images.flatMap(() => own) };
}
function polynomials(rows, s) { // values and slopes at a place, by Horner; a row: coefficients of rising powers
  const values = [], slopes = [];
  for (const row of rows) {
    let v = 0, d = 0;
    for (let i = row.length - 1; i >= 0; i--) { d = d * s + v; v = v * s + row[i]; }
    values.push(v); slopes.push(d);
  }
  return { values, slopes };
}
function lineIntegrals(rows, { gauss, weights }, [low, high] = [-1, 1]) { // int f g, f' g and f' g' over a part of [-1, 1]
  const n = rows.length, out = [mat(n, n), mat(n, n), mat(n, n)];
  gauss.forEach((s, q) => {
    const { values: f, slopes: d } = polynomials(rows, low + (high - low) * (s + 1) / 2), w = weights[q] * (high - low) / 2;
    for (let i = 0; i < n; i++) for (let j = 0; j < n; j++) { out[0].a[i * n + j] += w * f[i] * f[j]; out[1].a[i * n + j] += w * d[i] * f[j]; out[2].a[i * n + j] += w * d[i] * d[j]; }
  });
  return out;
}
function bareCell(data, width, depth, thickness, span = null) { // solvers/parametric/bare.py; of what lies within a span along x alone
  const { functions, lambda, mu, along, through } = data.bare, n = functions.length, whole = lineIntegrals(along, data.bare);
  const lines = [span ? lineIntegrals(along, data.bare, span) : whole, whole, lineIntegrals(through, data.bare)];
  const stretch = [width / thickness / 2, depth / thickness / 2, 0.5], volume = stretch[0] * stretch[1] * stretch[2];
  const k = mat(3 * n, 3 * n), m = mat(3 * n, 3 * n), g = zeros(9);
  const line = (axis, kind, a, b) => { const x = lines[axis][kind]; return x.a[a * x.m + b]; }; // kinds: ff, df, dd
  for (let f = 0; f < n; f++)
    for (let o = 0; o < n; o++) {
      const p = functions[f], q = functions[o], flat = [0, 1, 2].map((axis) => line(axis, 0, p[axis], q[axis]));
      for (let j = 0; j < 3; j++)
        for (let l = 0; l < 3; l++) {
          let v = volume / stretch[j] / stretch[l];
          for (let axis = 0; axis < 3 && v; axis++)
            v *= axis === j ? (axis === l ? line(axis, 2, p[axis], q[axis]) : line(axis, 1, p[axis], q[axis])) : (axis === l ? line(axis, 1, q[axis], p[axis]) : flat[axis]);
          g[3 * j + l] = v;
        }
      const trace = g[0] + g[4] + g[8], mass = volume * flat[0] * flat[1] * flat[2];
      for (let i = 0; i < 3; i++) {
        for (let c = 0; c < 3; c++) k.a[(3 * f + i) * 3 * n + 3 * o + c] = lambda * g[3 * i + c] + mu * ((i === c ? trace : 0) + g[3 * c + i]);
        m.a[(3 * f + i) * 3 * n + 3 * o + i] = mass;
      }
    }
  const odd = [];
  for (let f = data.face.count / 3; f < n; f++) for (let i = 0; i < 3; i++) odd.push((functions[f][0] % 2 === 1) !== (i === 0));
  const { gauss, weights } = data.bare, bottom = polynomials(through, -1).values, across = gauss.map((s) => polynomials(along, s).values), s = gauss.length, touch = mat(s * s, 3 * n), points = [], areas = [];
  for (let x = 0; x < s; x++)
    for (let y = 0; y < s; y++) {
      const [low, high] = span || [-1, 1], at = low + (high - low) * (gauss[x] + 1) / 2, flat = polynomials(along, at).values;
      points.push([at * width / 2, gauss[y] * depth / 2]); areas.push(weights[x] * (high - low) / 2 * weights[y] * width * depth / 4);
      functions.forEach(([i, j, r], f) => { touch.a[(x * s + y) * 3 * n + 3 * f + 2] = flat[i] * across[y][j] * bottom[r]; });
    }
  return { k, m, odd, width, depth, points, weights: areas, touch };
}
function stiffInside(data, whole, top, about) { // modes of its inside beyond `top` answer as at `about`: solvers/parametric/finite.py
  const b = data.face.count, n = whole.k.n, parts = [false, true].map((odd) => {
    const own = range(b, n).filter((i) => whole.odd[i - b] === odd), at = [...range(0, b), ...own];
    return { odd, own, ...condense(picked(whole.k, at, at), picked(whole.m, at, at), b, top, about) };
  });
  const shapes = mat(n, b + parts[0].modes.m + parts[1].modes.m);
  for (let i = 0; i < b; i++) shapes.a[i * shapes.m + i] = 1;
  parts.forEach(({ odd, own, inside }) => own.forEach((at, i) => {
    for (let c = 0; c < inside.m; c++) shapes.a[at * shapes.m + c + (odd && c >= b ? parts[0].modes.m : 0)] = inside.a[i * inside.m + c];
  }));
  return { ...among(whole, shapes), odd: parts.flatMap(({ odd, modes }) => Array(modes.m).fill(odd)), shapes };
}
function among(cell, shapes) { return { ...cell, k: congruent(cell.k, shapes), m: congruent(cell.m, shapes), touch: mul(cell.touch, shapes) }; }
function realRow(data, cells, kx, across = false) { // unknowns [lower edge, upper edge, inside] whose matrices are real: solvers/parametric/finite.py
  const { vertex, side, vertexOdd, acrossOdd, besideOdd, count } = data.face, half = -kx * cells[0].width / 2, two = cells.length > 1;
  const near = [Math.cos(half), Math.sin(half)], far = [near[0], -near[1]], turn = ([re, im], odd) => odd ? [-im, re] : [re, im];
  let rows = []; // an unknown's parts: cell, degree of freedom there, real and imaginary factor about the cell's middle
  const put = (...entries) => rows.push(entries.map(([cell, at, [re, im]]) => [cell, at, re, im]));
  const line = (cell, left, right, odd) => left.forEach((at, i) => { // of two panels each line is the other one's image: r + i t and sign (r - i t)
    if (!two) return put([0, at, turn(near, odd[i])], [0, right[i], turn(far, odd[i])]);
    const s = (odd[i] ? -1 : 1) * Math.SQRT1_2, [a, b] = cell ? [turn([Math.SQRT1_2, 0], true), turn([-s, 0], true)] : [[Math.SQRT1_2, 0], [s, 0]];
    put([0, at, times(near, a)], [0, right[i], times(far, b)], [1, at, times(near, b)], [1, right[i], times(far, a)]);
  });
  for (const [a, b, along] of [[0, 1, 2], [2, 3, 3]])
    cells.forEach((_, cell) => { line(cell, vertex[a], vertex[b], vertexOdd); side[along].forEach((at, i) => put([cell, at, turn([1, 0], acrossOdd[i])])); });
  cells.forEach((_, cell) => line(cell, side[0], side[1], besideOdd));
  cells.forEach(({ odd }, cell) => odd.forEach((own, i) => put([cell, count + i, turn([1, 0], own)])));
  const e = data.face.edge * cells.length, sign = range(0, e).map((i) => i % 3 === 1 ? -1 : 1);
  if (across && two) rows = shifted(data, rows, sign);
  const n = rows.length, among = (name) => {
    const out = mat(n, n);
    for (let r = 0; r < n; r++)
      for (let c = 0; c <= r; c++) {
        let v = 0;
        for (const [one, i, a, b] of rows[r]) for (const [other, j, p, q] of rows[c]) { const x = cells[one][name]; if (one === other && x && i < x.n && j < x.n) v += (a * p + b * q) * x.a[i * x.n + j]; }
        out.a[r * n + c] = out.a[c * n + r] = v;
      }
    return out;
  };
  return { k: among("k"), m: among("m"), among, rows, cells, e, sign };
}
function shifted(data, rows, sign) { // the upper edge in the order of the next row's lower one, half a pitch on, both in what the mirror y -> -y keeps after that shift
  const { edge, vertexOdd, vertex } = data.face, lines = vertex[0].length, out = rows.slice();
  const sum = (one, other, a, b) => [...one.map(([c, at, x, y]) => [c, at, a * x, a * y]), ...other.map(([c, at, x, y]) => [c, at, b * x, b * y])];
  for (let i = 0; i < edge; i++) {
    const [lower, upper] = [0, 2 * edge].map((start) => [rows[start + i], rows[start + edge + i]]);
    if (i < lines) {
      const s = vertexOdd[i] ? -1 : 1;
      out[2 * edge + i] = sum(upper[0], [], s, 0); out[3 * edge + i] = sum(upper[1], [], -s, 0);
      sign[i] *= s; sign[edge + i] *= -s;
      continue;
    }
    out[i] = sum(...lower, Math.SQRT1_2, Math.SQRT1_2); out[edge + i] = sum(...lower, Math.SQRT1_2, -Math.SQRT1_2);
    out[2 * edge + i] = sum(...upper, Math.SQRT1_2, Math.SQRT1_2); out[3 * edge + i] = sum(...upper, -Math.SQRT1_2, Math.SQRT1_2);
    sign[edge + i] *= -1;
  }
  return out;
}
function condense(k, m, kept, top, about) {
  const n = k.n, ki = block(k, kept, n, kept, n), mi = block(m, kept, n, kept, n), pull = plus(block(k, kept, n, 0, kept), block(m, kept, n, 0, kept), -about);
  let modes = mat(n - kept, 0), still;
  if (cholesky(plus(ki, mi, -top))) still = solved(cholesky(plus(ki, mi, -about)), pull);
  else {
    const { values, vectors } = symmetricPencil(ki, mi, true), low = values.filter((v) => v <= top).length, high = block(vectors, 0, ki.n, low, ki.n);
    modes = firstColumns(vectors, low);
    still = mul(scaledColumns(high, Array.from(values.slice(low), (v) => 1 / (v - about))), mulT(high, pull));
  }
  for (let i = 0; i < still.a.length; i++) still.a[i] = -still.a[i];
  const eye = mat(kept, kept + modes.m);
  for (let i = 0; i < kept; i++) eye.a[i * eye.m + i] = 1;
  const inside = beside(still, modes), shapes = below(eye, inside);
  return { still, modes, k: congruent(k, shapes), m: congruent(m, shapes), inside };
}
function columnPanels(data, design) { // solvers/plates/column.py and geometry/tiling.py, in m
  const { thickness, rows, extension } = design, pitch = design.pitch * data.box.panel[1], side = data.foot.footprint * design.side, half = data.zone_width / 2, longest = data.panel * thickness, lines = [0], feet = [];
  const count = rows ? data.box.panels : 1, none = Array(count).fill(false);
  const ofRow = (row) => none.map((_, i) => i === row % count); // in staggered rows, pillars alternate between the first and the second panel
  const bare = (to, even) => {
    const from = lines[lines.length - 1];
    let count = Math.max(1, Math.ceil((even ? 2 : 1) * (to - from) / longest - 1e-9));
    if (even) count = Math.ceil(count / 2);
    for (let i = 1; i <= count; i++) { lines.push(from + (to - from) * i / count); feet.push(none); }
  };
  if (!rows) { bare(half, true); if (extension > 1e-9) bare(half + extension, false); return { lines, feet, end: half + extension }; }
  const first = half + side / 2, end = first + (rows - 1) * pitch + side / 2 + extension;
  if (first - pitch / 2 <= half / 4) throw new Error(said(data, "middle"));
  if (extension < (pitch - side) / 2 - 1e-9) throw new Error(said(data, "cut", { least: (500 * (pitch - side)).toFixed(2) }));
  bare(first - pitch / 2, true);
  for (let row = 0; row < rows; row++) { lines.push(first + (row + 0.5) * pitch); feet.push(ofRow(row)); }
  if (end - lines[lines.length - 1] > 1e-9) bare(end, false);
  return { lines, feet, end };
}
function columnOf(data, pillarCell, design, window, kx, cells = new Map(), within = window) { // cells: kept from one wavenumber to the next
  const { lines, feet, end } = columnPanels(data, design), angular = data.angular * data.reference[0] / design.thickness, value = (hz) => (2 * Math.PI * hz / angular) ** 2;
  const top = value(data.reach * window[1]), about = value(Math.sqrt(window[0] * window[1])), e = data.face.edge * feet[0].length, known = new Map();
  const width = design.rows ? design.pitch * data.box.panel[0] : data.panel * design.thickness;
  const places = feet.map((own, i) => {
    const depth = lines[i + 1] - lines[i], keys = own.map((foot) => foot ? "foot" : depth.toFixed(10)), key = keys.join();
    keys.forEach((each, at) => { if (!cells.has(each)) cells.set(each, stiffInside(data, own[at] ? pillarCell() : bareCell(data, width, depth, design.thickness), top, about)); });
    if (!known.has(key)) {
      const row = realRow(data, keys.map((each) => cells.get(each)), kx);
      known.set(key, { row, short: condense(row.k, row.m, 2 * e, top, about) });
    }
    return { ...known.get(key), feet: own, depth, middle: (lines[i] + lines[i + 1]) / 2 };
  });
  const free = range(0, e).filter((i) => i % 3 !== 1), steps = [];
  places.forEach(({ short }, number) => {
    const behind = steps[number - 1], modes = short.k.n - 2 * e, more = behind ? behind.k.n - e : 0, lower = number ? range(0, e) : free;
    const order = [...range(e, 2 * e), ...lower, ...range(2 * e, 2 * e + modes + more)], total = 2 * e + modes + more;
    const whole = (name) => {
      const out = mat(total, total), at = [...range(0, e), ...range(2 * e + modes, total)], s = short[name];
      for (let i = 0; i < s.n; i++) for (let j = 0; j < s.n; j++) out.a[i * total + j] = s.a[i * s.n + j];
      if (behind) { const b = behind[name]; at.forEach((r, i) => at.forEach((c, j) => { out.a[r * total + c] += b.a[i * b.n + j]; })); }
      return picked(out, order, order);
    };
    steps.push(condense(whole("k"), whole("m"), e, top, about));
  });
  const last = steps[steps.length - 1], { values, vectors } = symmetricPencil(last.k, last.m, true);
  const least = within[0] < 0 ? -Infinity : value(within[0]), inside = range(0, values.length).filter((i) => values[i] >= least && values[i] <= value(within[1]));
  const frequency = inside.map((i) => Math.sqrt(Math.max(values[i], 0)) * angular / (2 * Math.PI));
  return { frequency, motions: motionsOf(data, places, steps, picked(vectors, range(0, vectors.n), inside), free), half_span: end, width, angular };
}
function motionsOf(data, places, steps, motion, free) { // of every cell, the outermost first: real and imaginary part (dof, modes)
  const out = [];
  for (let number = places.length - 1; number >= 0; number--) {
    const { row, short, middle, depth, feet } = places[number], { e, cells } = row, step = steps[number], count = motion.m, upper = block(motion, 0, e, 0, count), behind = mul(step.inside, motion);
    const lower = mat(e, count), unknowns = number ? range(0, e) : free, modes = short.k.n - 2 * e;
    unknowns.forEach((at, i) => lower.a.set(behind.a.subarray(i * count, (i + 1) * count), at * count));
    const local = below(below(lower, upper), block(behind, unknowns.length, unknowns.length + modes, 0, count)), whole = below(block(local, 0, 2 * e, 0, count), mul(short.inside, local));
    const own = cells.map((cell, index) => ({ cell, index, foot: feet[index], inRow: feet.includes(true), depth, middle, re: mat(cell.k.n, count), im: mat(cell.k.n, count) }));
    row.rows.forEach((entries, r) => entries.forEach(([cell, at, a, b]) => {
      const { re, im } = own[cell];
      for (let c = 0; c < count; c++) { const v = whole.a[r * count + c]; re.a[at * count + c] += a * v; im.a[at * count + c] += b * v; }
    }));
    out.push(...own);
    motion = below(lower, block(behind, unknowns.length + modes, behind.n, 0, count));
  }
  return out;
}
const linesOf = (data, design, end, middle) => [data.zone_width / 2, end - design.extension].flatMap((line) => [line - middle, -line - middle]);
function parted(data, cell, lines) { // its touch face's rule, parted at lines y = const: solvers/fem/surface.py
  const { gauss, weights } = data.bare, n = gauss.length, points = [], areas = [], rows = [], width = cell.touch.m, own = (i) => cell.touch.a.subarray(i * width, (i + 1) * width);
  for (let first = 0; first < cell.points.length; first += n * n) {
    const low = cell.points[first][1], high = cell.points[first + n - 1][1], middle = (low + high) / 2, half = (high - low) / (gauss[n - 1] - gauss[0]);
    const inside = lines.map((line) => (line - middle) / half).filter((at) => Math.abs(at) < 1 - 1e-9).sort((a, b) => a - b), ends = [-1, ...inside, 1];
    const t = inside.length ? ends.slice(1).flatMap((end, i) => gauss.map((s) => ends[i] + (end - ends[i]) * (s + 1) / 2)) : gauss;
    const share = inside.length ? ends.slice(1).flatMap((end, i) => weights.map((w) => (end - ends[i]) / 2 * w)) : weights;
    const values = t.map((at, r) => inside.length ? lagrange(gauss, at) : gauss.map((_, j) => +(r === j)));
    for (let i = 0; i < n; i++) {
      const start = first + i * n, across = cell.weights.slice(start, start + n).reduce((a, b) => a + b, 0) / 2;
      t.forEach((at, r) => {
        const row = zeros(width);
        values[r].forEach((v, j) => { if (v) own(start + j).forEach((u, c) => { row[c] += v * u; }); });
        points.push([cell.points[start][0], middle + half * at]); areas.push(across * share[r]); rows.push(row);
      });
    }
  }
  const touch = mat(rows.length, width);
  rows.forEach((row, i) => touch.a.set(row, i * width));
  return { ...cell, points, weights: areas, touch };
}
function profileOf(data, design, { motions, half_span }) { // u_z on the touch face
  return motions.flatMap(({ cell: whole, middle, re, im }) => {
    const cell = parted(data, whole, linesOf(data, design, half_span, middle)), x = mul(cell.touch, re), y = mul(cell.touch, im), count = re.m;
    return cell.points.map((point, i) => ({ x: point[0], y: point[1] + middle, weight: cell.weights[i], re: x.a.subarray(i * count, (i + 1) * count), im: y.a.subarray(i * count, (i + 1) * count) }));
  });
}
function measured(data, found, design) { // the target mode of a column's modes, and its level: solvers/measures
  const half = data.zone_width / 2, everything = [-Infinity, Infinity], { free_kx } = data.finite, places = profileOf(data, design, found);
  const modes = found.frequency.map((hz, c) => {
    let active = 0, area = 0, passive = 0, passiveArea = 0, own = 0, re = 0, im = 0;
    for (const p of places) {
      const square = p.re[c] ** 2 + p.im[c] ** 2;
      if (Math.abs(p.y) >= half) { passive += p.weight * square; passiveArea += p.weight; continue; }
      const shape = Math.cos(Math.PI * p.y / data.zone_width), cos = Math.cos(free_kx * p.x) * shape, sin = Math.sin(free_kx * p.x) * shape;
      active += p.weight * square; area += p.weight; own += p.weight * shape * shape;
      re += p.weight * (cos * p.re[c] + sin * p.im[c]); im += p.weight * (cos * p.im[c] - sin * p.re[c]);
    }
    const strength = (re * re + im * im) / own, confinement_db = decibels(data, active, area, passive, passiveArea);
    return { hz, mac: strength / active, strength, confinement_db, zone_share: confinement_db === null ? null : active / (active + passive) };
  });
  const best = verdictOf(data.rule, modes, -Infinity, everything, everything);
  return best && modes[best.index];
}
function decibels(data, one, area, other, otherArea) { // mean squares of two parts compared; null where one has no area
  return Math.min(area, otherArea) <= data.constants.negligible * Math.max(area, otherArea) ? null : 10 * Math.log10(one * otherArea / (area * other));
}
function windowsOf(data, thickness, search = false) { // pipeline/planning/mesh_rules.py at some thicknesses; where a search begins
  const { thicknesses, clamped, low, first, high } = data.windows, last = thicknesses.length - 1, place = (thickness - thicknesses[0]) / (thicknesses[last] - thicknesses[0]) * last;
  const start = Math.min(Math.max(Math.floor(place) - 2, 0), last - 5), weights = lagrange(range(start, start + 6), place);
  return [(search ? first : low) * thickness, Math.max(high * thickness, weights.reduce((sum, w, i) => sum + w * clamped[start + i], 0))];
}

// ---- the finite plate: solvers/parametric/finite.py, pipeline/models/live_column.py ----
function targetAlong(data, x) { // the free-free beam's shape, even or odd about the middle
  const { lines, kappa } = data.finite, s = x / data.zone_length;
  if (lines < 2) return lines ? s : 1;
  return lines % 2 ? Math.sin(kappa * s) / Math.sin(kappa / 2) + Math.sinh(kappa * s) / Math.sinh(kappa / 2) : Math.cos(kappa * s) / Math.cos(kappa / 2) + Math.cosh(kappa * s) / Math.cosh(kappa / 2);
}
function middlesOf(data, design, pitch) {
  const foot = data.foot.footprint * design.side, count = design.rows ? Math.floor((data.zone_length - foot) / pitch * (1 + 1e-9) + 1e-9) + 1 : Math.max(Math.round(data.zone_length / pitch), 1);
  return range(0, count).map((i) => (i - (count - 1) / 2) * pitch);
}
function finitePlate(data, pillarCell, design, window) {
  const { lines, known, wavenumbers: every, tried, independent, still } = data.finite, cells = new Map();
  const columns = every.map((kx, i) => columnOf(data, pillarCell, design, window, kx, cells, [-1, tried[i] * window[1]]));
  const kx = columns.flatMap((one, i) => one.frequency.map(() => every[i])), n = kx.length, { width } = columns[0], panels = design.rows ? data.box.panels : 1, first = middlesOf(data, design, panels * width), odd = lines % 2;
  const xs = [first, first.slice(0, -1).map((x) => x + width)].slice(0, panels); // the second panels of a pitch stand between the first ones
  const { angular } = columns[0], value = (hz) => (2 * Math.PI * hz / angular) ** 2, about = value(Math.sqrt(window[0] * window[1])), half = data.zone_width / 2;
  const along = (k, x) => odd ? [Math.sin(k * x), Math.cos(k * x)] : [Math.cos(k * x), -Math.sin(k * x)];
  const pieces = columns[0].motions.map((place, number) => ({ ...place, cell: parted(data, place.cell, linesOf(data, design, columns[0].half_span, place.middle)), even: columns.map((one) => one.motions[number].re).reduce(beside), odd: columns.map((one) => one.motions[number].im).reduce(beside),
    part: place.inRow ? 2 : Math.abs(place.middle) < half ? 1 : 0 }));
  const over = (data.zone_length - xs.reduce((sum, own) => sum + own.length, 0) * width) / 2, wide = 2 * Math.abs(over) / width, last = first[first.length - 1] + (over > 0 ? width : 0);
  const stripCells = new Map(), atEnd = over > 0 ? panels - 1 : 0, strips = pieces.map((piece) => Math.abs(over) <= 1e-9 * width || piece.index !== atEnd ? null
    : stripOf(data, design, piece, width, kx, along, over > 0 ? [-1, -1 + wide] : [1 - wide, 1], last, about, linesOf(data, design, columns[0].half_span, piece.middle), stripCells));
  const weight = over > 0 ? 2 : -2, kernels = xs.map((own) => kernelsOf(kx, own, odd));
  const whole = (forms, ends) => { // a form of the plate from even and odd ones of the column's panels and that of the strips
    const out = mat(n, n);
    out.a.set(ends.a);
    forms.forEach(([even, odd_], index) => { const { apart, together } = kernels[index]; for (let i = 0; i < n * n; i++) out.a[i] += ((even.a[i] + odd_.a[i]) * apart[i] + (even.a[i] - odd_.a[i]) * together[i]) / 2; });
    return halfSum(out);
  };
  const form = (chosen, of) => { // of(cell) acts on degrees of freedom
    const forms = xs.map(() => [mat(n, n), mat(n, n)]), ends = mat(n, n), add = (to, more, factor) => { for (let i = 0; i < n * n; i++) to.a[i] += factor * more.a[i]; };
    pieces.forEach((piece, number) => {
      if (!chosen(piece)) return;
      [piece.even, piece.odd].forEach((half, at) => add(forms[piece.index][at], of(piece.cell, half, piece.middle), 1));
      if (strips[number]) add(ends, of(strips[number].cell, strips[number].motion, piece.middle), weight);
    });
    return whole(forms, ends);
  };
  const stiff = [0, 1, 2].map((part) => form((piece) => piece.part === part, (cell, u) => congruent(cell.k, u)));
  const k = plus(plus(stiff[0], stiff[1]), stiff[2]), m = form(() => true, (cell, u) => congruent(cell.m, u));
  const largest = Math.max(...range(0, n).map((i) => m.a[i * (n + 1)])), size = range(0, n).map((i) => m.a[i * (n + 1)] > still * largest ? 1 / Math.sqrt(m.a[i * (n + 1)]) : 0);
  const both = (x) => transposed(scaledColumns(transposed(scaledColumns(x, size)), size)), mass = symmetricEigen(both(m), true);
  const kept = range(0, n).filter((i) => mass.values[i] > independent * mass.values[n - 1]);
  const basis = scaledColumns(picked(mass.vectors, range(0, n), kept), kept.map((i) => 1 / Math.sqrt(mass.values[i])));
  for (let i = 0; i < n; i++) for (let j = 0; j < basis.m; j++) basis.a[i * basis.m + j] *= size[i];
  const own = symmetricEigen(congruent(k, basis), true), inside = range(0, own.values.length).filter((i) => own.values[i] <= value(known * window[1]));
  const vectors = mul(basis, picked(own.vectors, range(0, basis.m), inside)), among = (x) => congruent(x, vectors);
  const end = columns[0].half_span, faces = facesOf(data, design, { pieces, strips, weight, xs, kx, along, form, last, beyond: end - design.extension });
  return { values: inside.map((i) => own.values[i]), zone: among(stiff[1]), rows: among(stiff[2]), vectors, pieces, xs, kx, along, end, angular,
    faces: { ...faces, forms: faces.forms.map(among), overlap: mulT({ n, m: 1, a: faces.overlap }, vectors).a } };
}
function kernelsOf(kx, xs, odd) {
  const n = kx.length, apart = zeros(n * n), together = zeros(n * n), kept = new Map();
  const sum = (k) => { const key = Math.abs(k).toFixed(6); if (!kept.has(key)) kept.set(key, xs.reduce((s, x) => s + Math.cos(k * x), 0)); return kept.get(key); };
  for (let i = 0; i < n; i++) for (let j = 0; j < n; j++) { apart[i * n + j] = sum(kx[i] - kx[j]); together[i * n + j] = (odd ? -1 : 1) * sum(kx[i] + kx[j]); }
  return { apart, together };
}
function stripOf(data, design, piece, pitch, kx, along, span, x, about, lines, known) { // of the plate beyond its whole cells, or lacking in the last ones
  const key = `${piece.foot} ${piece.depth.toFixed(10)}`;
  if (!known.has(key)) {
    const { shapes } = piece.foot ? stiffInside(data, bareCell(data, pitch, piece.depth, design.thickness), 0, about) : piece.cell;
    known.set(key, among(bareCell(data, pitch, piece.depth, design.thickness, span), shapes));
  }
  const n = kx.length, cell = known.get(key), moved = mat(cell.k.n, n), at = kx.map((k) => along(k, x));
  for (let i = 0; i < moved.n; i++) for (let j = 0; j < n; j++) moved.a[i * n + j] = at[j][0] * piece.even.a[i * n + j] + at[j][1] * piece.odd.a[i * n + j];
  return { cell: parted(data, cell, lines), motion: moved };
}
function facesOf(data, design, { pieces, strips, weight, xs, kx, along, form, last, beyond }) {
  const n = kx.length, half = data.zone_width / 2, parts = [(y) => y < half, (y) => y >= half, (y) => y > beyond], areas = [0, 0, 0], overlap = zeros(n);
  const square = (cell, at) => { // of u_z over some points, as a form of the cell's degrees of freedom
    const rows = picked(cell.touch, at, range(0, cell.touch.m)), weighted = transposed(scaledColumns(transposed(rows), at.map((i) => cell.weights[i])));
    return mulT(rows, weighted);
  };
  const forms = parts.map((own) => form(() => true, (cell, u, middle) => {
    const at = range(0, cell.points.length).filter((i) => own(Math.abs(cell.points[i][1] + middle)));
    return at.length ? congruent(square(cell, at), u) : mat(n, n);
  }));
  let norm = 0;
  const gather = (cell, middle, motions, places, factor) => {
    const inside = [], across = [];
    cell.points.forEach((point, i) => {
      const y = point[1] + middle;
      parts.forEach((own, part) => { if (own(Math.abs(y))) areas[part] += factor * places.length * cell.weights[i]; });
      if (parts[0](Math.abs(y))) { inside.push(i); across.push(Math.sin(Math.PI * (y + half) / data.zone_width)); }
    });
    if (!inside.length) return;
    for (const x of places) { // the target shape's work on every degree of freedom, then on the trial functions
      const work = mat(1, cell.touch.m);
      inside.forEach((i, r) => {
        const shape = across[r] * targetAlong(data, x + cell.points[i][0]), w = factor * cell.weights[i] * shape;
        norm += w * shape;
        for (let c = 0; c < work.m; c++) work.a[c] += w * cell.touch.a[i * work.m + c];
      });
      const moved = motions.map((motion) => mul(work, motion).a);
      for (let c = 0; c < n; c++) { const turn = moved[1] ? along(kx[c], x) : [1]; turn.forEach((v, part) => { overlap[c] += v * moved[part][c]; }); }
    }
  };
  pieces.forEach((piece, number) => {
    gather(piece.cell, piece.middle, [piece.even, piece.odd], xs[piece.index], 1);
    if (strips[number]) gather(strips[number].cell, piece.middle, [strips[number].motion], [last], weight);
  });
  return { forms, areas, overlap, norm, factor: 1 / design.thickness ** 2 };
}
function detuned(data, plate, zone, rows) { // frequencies and measures where zone and rows alone ring higher by relative changes
  const n = plate.values.length, k = mat(n, n);
  for (let i = 0; i < n * n; i++) k.a[i] = 2 * (zone * plate.zone.a[i] + rows * plate.rows.a[i]);
  plate.values.forEach((v, i) => { k.a[i * (n + 1)] += v; });
  const { values, vectors } = symmetricEigen(k, true), { forms, areas, overlap, norm, factor } = plate.faces;
  const squares = forms.map((form) => { const moved = mul(form, vectors); return range(0, n).map((c) => { let s = 0; for (let i = 0; i < n; i++) s += vectors.a[i * n + c] * moved.a[i * n + c]; return s; }); });
  const level = (c, part) => decibels(data, squares[0][c], areas[0], squares[part][c], areas[part]);
  const modes = range(0, n).map((c) => {
    const confinement = level(c, 1), along = mulT({ n, m: 1, a: overlap }, block(vectors, 0, n, c, c + 1)).a[0] ** 2 / norm;
    return { hz: Math.sqrt(Math.max(values[c], 0)) * plate.angular / (2 * Math.PI), confinement_db: confinement, extension_db: level(c, 2), mac: along / squares[0][c], strength: factor * along,
      zone_share: confinement === null ? null : squares[0][c] / (squares[0][c] + squares[1][c]) };
  });
  return { modes, vectors };
}
const weightOf = (one) => one.strength * (one.zone_share === null ? 1 : one.zone_share) * one.mac;
function verdictOf(rule, modes, low, ends, reach, missing = null) { // solvers/measures/target_mode.py over modes within reach
  const { similar, clear, lead, majority, rival, named } = rule, inside = ([from, to], { hz }) => hz >= from && hz <= to, known = modes.map((one) => inside(reach, one));
  const weights = modes.map((one, i) => known[i] ? weightOf(one) : 0), candidate = modes.map((one, i) => known[i] && one.hz >= low && one.mac >= similar);
  let best = -1;
  modes.forEach((_, i) => { if (candidate[i] && weights[i] > 0 && (best < 0 || weights[i] > weights[best])) best = i; });
  if (best < 0) return null;
  const others = weights.filter((_, i) => i !== best), own = weights[best], bound = Math.max(0, 1 - modes.reduce((sum, one, i) => known[i] ? sum + one.strength : sum, 0));
  const near = modes.reduce((sum, one, i) => i === best || inside(ends, one) ? sum + weights[i] : sum, 0);
  const single = modes[best].mac >= clear && own >= lead * Math.max(missing ?? bound, ...others) && own >= majority * near;
  return { index: best, status: single ? "single" : "split", open: lead * bound > own, rivals: Math.min(others.filter((w) => w >= rival * own).length, named),
    tied: (least) => [best, ...range(0, modes.length).filter((i) => i !== best && candidate[i] && weights[i] >= least * own)] };
}
function searched(rule, modes, window) { // solvers/measures/target_mode.py where all modes that are known are at hand
  let ends = window, reach = window, steps = 0, found = null;
  for (let round = 0; round < rule.rounds; round++) {
    found = verdictOf(rule, modes, window[0], ends, reach);
    if (!found) return null;
    const { hz } = modes[found.index], wider = [Math.min(ends[0], (1 - rule.past) * hz), Math.max(ends[1], (1 + rule.past) * hz)];
    if (wider[0] !== ends[0] || wider[1] !== ends[1]) { ends = wider; reach = [Math.min(reach[0], wider[0]), Math.max(reach[1], wider[1])]; }
    else if (!found.open || verdictOf(rule, modes, window[0], ends, reach, 0).status !== "single") return found;
    else if (reach[0] > 0) reach = [0, reach[1]];
    else if (steps++ < rule.steps) reach = [0, rule.step * reach[1]];
    else return found;
  }
  return found;
}
function changed(data, plate, window, zone = 0, rows = 0) {
  const { modes, vectors } = detuned(data, plate, zone, rows), found = searched(data.rule, modes, window), least = 1 / data.rule.lead;
  return { found, modes, vectors, tied: found ? found.tied(least).map((i) => modes[i]) : [] };
}
function apart(modes, error) { // groups of modes of which each lies within a relative error of the next in frequency
  const groups = [];
  for (const one of [...modes].sort((a, b) => a.hz - b.hz)) {
    const last = groups.at(-1);
    if (last && one.hz - last.at(-1).hz <= error * last.at(-1).hz) last.push(one); else groups.push([one]);
  }
  return groups;
}
function candidate(group, error, end, tied_db) { // another mode that may be the target mode, over what it becomes under changes
  const ends = (name) => { const every = group.map((one) => one[name]); return every.includes(null) ? null : [Math.min(...every), Math.max(...every)]; }, [low, high] = ends("hz"), levels = ends("confinement_db");
  return { frequency_hz: (1 - end) * (low + high) / 2, frequency_error: (high - low) / (high + low) + error, confinement_db: levels && (levels[0] + levels[1]) / 2, confinement_error_db: levels && (levels[1] - levels[0]) / 2 + tied_db };
}
function plateOf(data, pillarCell, design, meshError) {
  const search = windowsOf(data, design.thickness, true), plate = finitePlate(data, pillarCell, design, search), { found, modes, vectors, tied } = changed(data, plate, search);
  if (!found) return { why_not: said(data, "no_mode") };
  const best = modes[found.index], { waves, sides, layer, changes, near, sharing, tied: tied_db } = data.finite, end = layer * design.thickness / 2, frequency_hz = best.hz * (1 - end);
  const error = waves + sides * design.thickness ** 2 + end + meshError(frequency_hz), each = [1, -1].flatMap((sign) => range(0, changes).map((i) => { const change = error * (2 * i / (changes - 1) - 1); return changed(data, plate, search, change, sign * change); }));
  const others = each.filter((one) => one.found), target = [...tied, ...others.flatMap((one) => one.tied)], single = others.length === each.length && others.every((one) => one.found.status === "single");
  const groups = apart([best, ...target], error), own = groups.find((group) => group.includes(best)), candidates = groups.filter((group) => group !== own).map((group) => candidate(group, error, end, tied_db));
  const frequency_error = Math.max(error, ...own.map((one) => Math.abs(one.hz / best.hz - 1)).map((off) => off > error ? off + error : error)), between = (name) => { const every = own.map((one) => one[name]); return best[name] === null ? null : [Math.min(...every), Math.max(...every)]; };
  const half_db = (range, own) => range && tied_db + Math.max(range[1] - own, own - range[0]), range_db = between("confinement_db"), close = modes.filter((one) => one !== best && one.strength >= sharing * best.strength && Math.abs(one.hz / best.hz - 1) <= near * error);
  const rival = close.length ? close.reduce((a, b) => Math.abs(b.hz - best.hz) < Math.abs(a.hz - best.hz) ? b : a).hz : null, warnings = [];
  if (rival !== null && range_db) warnings.push(said(data, "near", { hz: frequency(rival, error), error: percent(error), least: level(range_db[0], null), most: level(range_db[1], null) }));
  if (!single) warnings.push(said(data, "split"));
  if (candidates.length) warnings.push(said(data, "others", { named: candidates.map((one) => frequency(one.frequency_hz, one.frequency_error)).join(", ") }));
  const { mac, zone_share, confinement_db, extension_db } = best;
  return { confinement_db, extension_db, mac, zone_share, frequency_hz, frequency_error, confinement_error_db: half_db(range_db, confinement_db), extension_error_db: half_db(between("extension_db"), extension_db),
    status: single ? "single" : "split", near_hz: rival, others: candidates, rivals: found.rivals, warnings, profile: shapeOf(data, plate, mul(plate.vectors, block(vectors, 0, vectors.n, found.index, found.index + 1)).a), half_width_mm: 500 * data.zone_width, half_span_mm: 1e3 * plate.end };
}
function shapeOf(data, plate, mode) { // the root mean square of u_z along x over the distance from the middle, the largest 1
  const slots = data.profile, area = zeros(slots), square = zeros(slots), { pieces, xs, kx, along, end } = plate, every = xs.map((own) => own.map((x) => kx.map((k, i) => { const [even, odd] = along(k, x); return [even * mode[i], odd * mode[i]]; })));
  for (const { cell, index, middle, even, odd } of pieces) {
    const phases = every[index], share = phases.length / xs[0].length, e = mul(cell.touch, even), o = mul(cell.touch, odd), n = kx.length;
    cell.points.forEach((point, i) => {
      const slot = Math.min(Math.floor(Math.abs(point[1] + middle) / end * slots), slots - 1);
      const mean = phases.reduce((sum, row) => { let u = 0; for (let c = 0; c < n; c++) u += row[c][0] * e.a[i * n + c] + row[c][1] * o.a[i * n + c]; return sum + u * u; }, 0) / phases.length;
      area[slot] += share * cell.weights[i]; square[slot] += share * cell.weights[i] * mean;
    });
  }
  const full = range(0, slots).filter((i) => area[i] > 0), level = full.map((i) => Math.sqrt(square[i] / area[i])), high = Math.max(...level);
  return { y_mm: full.map((i) => 1e3 * (i + 0.5) / slots * end), level: level.map((v) => v / high) };
}

// ---- decay per row: solvers/waves/complex_bands.py, branches.py ----
function decayOf(data, pillarCell, design, window) {
  if (data.kx > Math.PI / design.pitch) return { frequency_hz: [], db_per_row: [], kx_per_m: data.kx };
  const pillar = pillarCell(), bare = range(1, data.box.panels).map(() => bareCell(data, pillar.width, design.pitch * data.box.panel[1], design.thickness));
  const whole = realRow(data, [pillar, ...bare], data.kx, true), row = { ...whole, dropped: whole.among("dropped") };
  const angular = data.angular * data.reference[0] / design.thickness;
  return { ...bisected(data.decay, data.constants.steepest_db, window, (f) => flexuralDb(data, row, (2 * Math.PI * f / angular) ** 2)), kx_per_m: data.kx };
}
function bisected({ points, finer, narrow, straight, alike }, steepest, [low, high], decay) { // _bisected in pipeline/explore/answer.py
  const hz = range(0, points).map((i) => low + (high - low) * i / (points - 1)), db = hz.map(decay), least = 1.5 * (high - low) / (points - 1) / narrow;
  for (let k = 0; k < finer; k++) {
    const level = db.map((v) => v === null ? steepest : v), step = range(1, hz.length).map((i) => hz[i] - hz[i - 1]), slope = step.map((h, i) => (level[i + 1] - level[i]) / h);
    const bend = [0, ...range(1, step.length).map((i) => Math.abs(slope[i] - slope[i - 1])), 0], off = step.map((h, i) => h > least ? h * Math.sqrt(bend[i] * bend[i + 1]) : 0);
    const most = Math.max(...off);
    if (most < straight) break;
    const at = off.findIndex((v) => v >= alike * most), middle = (hz[at] + hz[at + 1]) / 2;
    hz.splice(at + 1, 0, middle); db.splice(at + 1, 0, decay(middle));
  }
  return { frequency_hz: hz, db_per_row: db };
}
function softening(data, edge, eigenvalue) { // of what the inner functions left out answer: solvers/superelement/cell.py
  const known = Math.min(eigenvalue, data.constants.known * edge);
  return known ** 2 * (1 + edge / (edge - known)) / 2;
}
function flexuralDb(data, row, eigenvalue) {
  const { steepest_db, propagating, felt, tiny } = data.constants, { e, sign } = row, n = row.k.n, d = plus(plus(row.k, row.m, -eigenvalue), row.dropped, -softening(data, row.cells[0].edge, eigenvalue)), side = 2 * e;
  const follow = linear(block(d, side, n, side, n), block(d, side, n, 0, side)); // the inside is minus this times the edges
  const edges = halfSum(plus(block(d, 0, side, 0, side), mul(block(d, 0, side, side, n), follow), -1));
  const even = range(0, e).filter((i) => sign[i] > 0), odd = range(0, e).filter((i) => sign[i] < 0);
  const bb = block(edges, 0, e, 0, e), bt = scaledColumns(block(edges, 0, e, e, side), sign), together = plus(bb, bt), apart = plus(bb, bt, -1);
  const g = plus(picked(apart, even, odd), picked(together, even, odd), -1), minus = plus(mat(g.n, g.m), g, -1), a = even.length, b = odd.length;
  const left = below(beside(picked(together, even, even), minus), beside(mat(b, a), picked(apart, odd, odd)));
  const right = below(beside(picked(apart, even, even), mat(a, b)), beside(transposed(minus), picked(together, odd, odd)));
  const pencil = linear(right, left), rows = range(0, e).map((i) => Array.from(pencil.a.subarray(i * e, (i + 1) * e)));
  const eigen = new MlMatrix.EigenvalueDecomposition(rows, { assumeSymmetric: false });
  let least = null;
  for (let c = 0; c < e; c++) {
    const re = eigen.realEigenvalues[c], im = eigen.imaginaryEigenvalues[c], size = Math.hypot(re, im), tau = [Math.sqrt(Math.max((size + re) / 2, 0)), Math.sign(im || 1) * Math.sqrt(Math.max((size - re) / 2, 0))];
    const factor = over([1 - tau[0], -tau[1]], [1 + tau[0], tau[1]]), amount = Math.max(Math.hypot(...factor), tiny), log = Math.abs(Math.log(amount));
    const db = log > propagating ? 20 * log / Math.LN10 : 0;
    if (db > steepest_db || (least !== null && db >= least)) continue;
    const vector = eigenvector(eigen, c, im), q = range(0, e).map(() => [0, 0]);
    even.forEach((at, i) => { q[at] = size < 1e-18 ? vector[i] : times(vector[i], tau); });
    odd.forEach((at, i) => { q[at] = vector[a + i]; });
    const motion = [...q, ...q.map((v) => times(v, factor))];
    for (let i = 0; i < follow.n; i++) {
      let x = 0, y = 0;
      for (let j = 0; j < side; j++) { const f = follow.a[i * side + j]; x -= f * motion[j][0]; y -= f * motion[j][1]; }
      motion.push([x, y]);
    }
    if (flexuralShare(data, row, motion) > felt) least = db;
  }
  return least;
}
const times = (x, y) => [x[0] * y[0] - x[1] * y[1], x[0] * y[1] + x[1] * y[0]];
const over = (x, y) => { const s = y[0] * y[0] + y[1] * y[1]; return [(x[0] * y[0] + x[1] * y[1]) / s, (x[1] * y[0] - x[0] * y[1]) / s]; };
function eigenvector(eigen, c, im) { // of a real matrix: conjugate pairs share two columns
  const v = eigen.eigenvectorMatrix, n = v.rows, first = im > 0 ? c : c - 1;
  if (im === 0) return range(0, n).map((i) => [v.get(i, c), 0]);
  return range(0, n).map((i) => [v.get(i, first), Math.sign(im) * v.get(i, first + 1)]);
}
function linear(x, y) { // x^-1 y by Gauss with row exchanges
  const n = x.n, w = y.m, a = x.a.slice(), out = mat(n, w);
  out.a.set(y.a);
  const exchange = (z, width, i, j) => { for (let k = 0; k < width; k++) [z[i * width + k], z[j * width + k]] = [z[j * width + k], z[i * width + k]]; };
  for (let c = 0; c < n; c++) {
    let best = c;
    for (let r = c + 1; r < n; r++) if (Math.abs(a[r * n + c]) > Math.abs(a[best * n + c])) best = r;
    if (best !== c) { exchange(a, n, c, best); exchange(out.a, w, c, best); }
    for (let r = c + 1; r < n; r++) {
      const f = a[r * n + c] / a[c * n + c];
      if (!f) continue;
      for (let k = c + 1; k < n; k++) a[r * n + k] -= f * a[c * n + k];
      for (let k = 0; k < w; k++) out.a[r * w + k] -= f * out.a[c * w + k];
    }
  }
  for (let c = n - 1; c >= 0; c--)
    for (let k = 0; k < w; k++) {
      let v = out.a[c * w + k];
      for (let j = c + 1; j < n; j++) v -= a[c * n + j] * out.a[j * w + k];
      out.a[c * w + k] = v / a[c * n + c];
    }
  return out;
}
function flexuralShare(data, row, motion) { // of <|u_z|^2> in <|u|^2>, means through the thickness along the cell's sides
  const { layers, count } = data.face, lines = data.lines, n = lines.n, flat = row.cells.map(() => [0, 1, 2].map(() => range(0, n).map(() => [0, 0])));
  row.rows.forEach((entries, r) => entries.forEach(([cell, at, a, b]) => {
    if (at >= count || Math.floor(at / 3) % layers) return;
    const v = flat[cell][at % 3][Math.floor(at / 3) / layers], p = times([a, b], motion[r]);
    v[0] += p[0]; v[1] += p[1];
  }));
  const squares = [0, 1, 2].map((axis) => flat.reduce((sum, own) => { const u = own[axis]; let s = 0; for (let i = 0; i < n; i++) for (let j = 0; j < n; j++) s += lines.a[i * n + j] * (u[i][0] * u[j][0] + u[i][1] * u[j][1]); return sum + s; }, 0));
  return squares[2] / Math.max(squares[0] + squares[1] + squares[2], Number.MIN_VALUE);
}

// ---- a design: pipeline/explore/answer.py ----
function said(data, name, values = {}) { // Python's own words; its :g writes six digits
  return data.words[name].replace(/\{(\w+)(:g)?\}/g, (_, key, short) => short ? String(+values[key].toPrecision(6)) : values[key]).trim();
}
function faultsOf(data, given) {
  const out = [];
  for (const [name, limit] of Object.entries(data.limits)) {
    const value = given[name], told = { ...limit, value };
    if (!Number.isFinite(value)) out.push(said(data, "number", told));
    else if (value < limit.low || value > limit.high) out.push(said(data, "limit", told));
    else if (name === "rows" && !Number.isInteger(value)) out.push(said(data, "whole", told));
  }
  if (out.length) return out;
  data.box.names.forEach((name, i) => {
    const value = given[name], [low, high] = [1e3 * data.box.low[i], 1e3 * data.box.high[i]];
    if (!(value >= low * (1 - 1e-9) && value <= high * (1 + 1e-9))) out.push(said(data, "outside", { name, value, low, high }));
  });
  const gap = 1e3 * data.box.clearance, { side, pitch } = given, { narrow } = data.box;
  if (!(narrow * pitch - data.foot.widest * side >= gap * (1 - 1e-9))) out.push(said(data, "tight", { side, pitch, gap, narrow }));
  if (!out.length && data.box.panels > 1 && given.rows > 1 && 1e3 * data.zone_length < pitch + data.foot.footprint * side) out.push(said(data, "shifted", { least: pitch + data.foot.footprint * side }));
  if (!out.length && given.rows && data.zone_width < 2e-3 * side) out.push(said(data, "narrow", { side }));
  return out;
}
function warningsOf(data, design) {
  const out = [], edge = Math.PI / design.pitch;
  if (data.kx > edge) out.push(said(data, "beyond", { kx: figure(data.kx), edge: figure(edge) }));
  if (data.half_wave < data.constants.short * design.thickness) out.push(said(data, "short_wave"));
  if (design.rows * design.pitch * data.box.panel[1] + design.extension > data.constants.wide_m) out.push(said(data, "wide"));
  return out;
}
const inMetres = (given) => Object.fromEntries(Object.entries(given).map(([name, value]) => [name, name === "rows" ? value : value / 1e3]));
function cloudOf(data, first) {
  let last = null; // plates with the same cell come one after another
  const cellOf = (sizes) => () => {
    if (!last || last.key !== sizes.join()) last = { key: sizes.join(), cell: joinedCell(data, prepared(data, sizes, data.face_inner.modes, pillarBlocks(data, data.blocks)), sizes) };
    return last.cell;
  };
  return data.cloud.slice(first, first + data.batch).map(({ mass_g, ...given }) => {
    const design = inMetres(given), sizes = [design.thickness, design.height, design.side, design.pitch], out = { design: given, mass_g, frequency_hz: null, confinement_db: null };
    const window = windowsOf(data, design.thickness);
    try {
      const best = measured(data, columnOf(data, cellOf(sizes), design, window, data.finite.free_kx), design);
      if (best) Object.assign(out, { frequency_hz: best.hz, confinement_db: best.confinement_db });
    } catch { /* no live answer for this one */ }
    return out;
  });
}
function answerOf(data, given) {
  const faults = faultsOf(data, given);
  if (faults.length) throw new Error(faults.join("; "));
  const design = inMetres(given);
  const sizes = [design.thickness, design.height, design.side, design.pitch], ready = prepared(data, sizes);
  const window = windowsOf(data, design.thickness);
  let kept = null;
  const pillarCell = () => kept = kept || joinedCell(data, ready, sizes);
  const out = { design: given, warnings: warningsOf(data, design), bands: bandsOf(data, ready, sizes), rows: decayOf(data, pillarCell, design, window) };
  try { out.plate = plateOf(data, pillarCell, design, (hz) => meshAt(out.bands, hz)); } catch (fault) { out.plate = { why_not: fault.message }; }
  out.warnings.push(...(out.plate.warnings || []));
  delete out.plate.warnings;
  return out;
}
