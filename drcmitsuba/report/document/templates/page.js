"use strict";
(async () => {
  const $ = (id) => document.getElementById(id);
  const { labels: t, facades } = JSON.parse($("drawn").textContent);
  const DARKEST = 10, BRIGHTEST = 10000; // colours of illuminances [lx]
  const INK = "#222", MARK = "#d55e00";
  const VIRIDIS = [
    "440154", "481a6c", "472f7d", "414487", "39568c", "31688e", "2a788e", "23888e", "1f988b",
    "22a884", "35b779", "54c568", "7ad151", "a5db36", "d2e21b", "fde725",
  ].map((hex) => [0, 2, 4].map((i) => parseInt(hex.slice(i, i + 2), 16)));
  const OUTLINES = {
    surroundings: ["#5a5a5a", 1], furniture: ["#fff", 1.5], room: [INK, 2], glazing: ["#56b4e9", 5],
  };

  const filled = (text, values) => text.replace(/\{(\w+)\}/g, (all, key) => values[key] ?? all);
  const clamped = (value, low, high) => Math.min(Math.max(value, low), high);

  async function unpacked(array) {
    const raw = Uint8Array.from(atob(array.text), (c) => c.charCodeAt(0));
    const stream = new Blob([raw]).stream().pipeThrough(new DecompressionStream("deflate"));
    const planes = new Uint8Array(await new Response(stream).arrayBuffer());
    const count = planes.length / array.bytes;
    const out = new { 1: Uint8Array, 2: Uint16Array, 4: Uint32Array }[array.bytes](count);
    for (let plane = 0; plane < array.bytes; plane++)
      for (let i = 0; i < count; i++) out[i] |= planes[plane * count + i] << (8 * plane);
    for (let i = 0; i < count; i++) if (i % array.row) out[i] += out[i - 1];
    return array.low ? Float64Array.from(out, (value) => value + array.low) : out;
  }

  async function unpackedAll(part) { // replaces packed arrays of an object, and of objects in it
    for (const [key, value] of Object.entries(part)) {
      if (value === null || typeof value !== "object") continue;
      if ("text" in value) part[key] = await unpacked(value);
      else await unpackedAll(value);
    }
  }

  function colour(share) {
    const at = clamped(share, 0, 1) * (VIRIDIS.length - 1), i = Math.min(Math.floor(at), 14);
    const mixed = VIRIDIS[i].map((low, k) => Math.round(low + (VIRIDIS[i + 1][k] - low) * (at - i)));
    return `rgb(${mixed})`;
  }
  const ofLux = (lux) => Math.log(lux / DARKEST) / Math.log(BRIGHTEST / DARKEST);
  const LUX = { share: ofLux, ticks: [10, 30, 100, 300, 1000, 3000, 10000], unit: "lx" };
  const linear = (most, unit, limit) => ({
    share: (value) => value / most, unit, limit,
    ticks: [0, 0.25, 0.5, 0.75, 1].map((part) => part * most),
  });

  function drawScale(canvas, scale, words) {
    const g = canvas.getContext("2d"), left = 20, width = canvas.width - 70;
    g.clearRect(0, 0, canvas.width, canvas.height);
    for (let x = 0; x < width; x++) {
      g.fillStyle = colour(x / width);
      g.fillRect(left + x, 4, 1.5, 12);
    }
    g.fillStyle = INK;
    g.font = "12px sans-serif";
    g.textAlign = "center";
    const marked = scale.limit === undefined ? NaN : left + width * scale.share(scale.limit);
    for (const tick of scale.ticks) {
      const x = left + scale.share(tick) * width;
      if (x > marked - 20 && x < marked + 80) continue; // the limit's words stand there
      g.fillText(scale.names?.[tick] ?? String(+tick.toFixed(1)), x, 32);
    }
    g.textAlign = "left";
    g.fillText(scale.unit, left + width + 14, 15);
    if (scale.limit !== undefined) {
      g.fillStyle = MARK;
      g.fillRect(marked - 1.5, 0, 3, 20);
      g.fillText(`${t.js_limit} ${+scale.limit.toFixed(1)}`, Math.min(marked - 5, left + width - 40), 32);
    }
    canvas.setAttribute("aria-label", words);
  }

  class Facade {
    constructor(content, index) {
      Object.assign(this, content);
      this.index = index;
      this.points = this.x.length;
      this.tiles = Float64Array.from( // corners are told from their point
        this.tiles, (away, i) => away + (Math.floor(i / this.points) % 2 ? this.y : this.x)[i % this.points]);
      const hours = this.hours;
      if (!hours) return;
      const first = Date.parse(`${hours.first}Z`);
      this.times = Array.from(hours.minutes, (minutes) => first + 60000 * minutes);
      this.at = new Map(this.times.map((time, i) => [time, i]));
      this.lux = Float32Array.from({ length: 65536 }, (_, n) => (n ? (1 + hours.step) ** (n - 1) : 0));
      this.sunBytes = Math.ceil(this.points / 8);
    }
    light(hour, point) { return this.lux[this.hours.light[hour * this.points + point]]; }
    inSun(hour, point) {
      return (this.hours.sun[hour * this.sunBytes + (point >> 3)] >> (point & 7)) & 1;
    }
    onSheet(sheet) {
      this.bySheet ??= this.sheets.map((_, k) => Array.from(this.x.keys()).filter((i) => this.sheet[i] === k));
      return this.bySheet[sheet];
    }
    view(sheet) { // lowest and highest x, y of a sheet [mm]
      const xs = [], ys = [];
      for (const i of this.onSheet(sheet))
        for (let k = 0; k < 8; k += 2) {
          xs.push(this.tiles[k * this.points + i]);
          ys.push(this.tiles[(k + 1) * this.points + i]);
        }
      for (const line of this.sheets[sheet].outlines.room ?? [])
        line.forEach((value, k) => (k % 2 ? ys : xs).push(value));
      const ends = (v) => [v.reduce((a, b) => Math.min(a, b), Infinity), v.reduce((a, b) => Math.max(a, b), -Infinity)];
      return [ends(xs), ends(ys)];
    }
    nearest(x, y, sheet) {
      let best = -1, least = Infinity;
      for (let i = 0; i < this.points; i++) {
        const away = (this.x[i] - x) ** 2 + (this.y[i] - y) ** 2;
        if (this.sheet[i] === sheet && away < least) [best, least] = [i, away];
      }
      return best;
    }
    closed(hour) { // mean over the groups of panes of how far they are from open
      const groups = this.hours.groups;
      const shares = groups.map((group) => group.state[hour] / (group.states.length - 1));
      return groups.length ? shares.reduce((a, b) => a + b, 0) / groups.length : 0;
    }
  }

  class Plan { // canvas with a façade's points in colours
    constructor(canvas, facade) {
      Object.assign(this, { canvas, facade });
      canvas.addEventListener("pointermove", (event) => this.choose(event, false));
      canvas.addEventListener("click", (event) => this.choose(event, true));
      canvas.addEventListener("keydown", (event) => this.step(event));
    }
    lay(sheet) {
      this.number = Math.min(sheet, this.facade.sheets.length - 1);
      const [[left, right], [bottom, top]] = this.facade.view(this.number);
      const margin = 0.03 * Math.max(right - left, top - bottom, 1), width = right - left + 2 * margin;
      const height = Math.max(top - bottom + 2 * margin, width / 4);
      this.canvas.width = 640;
      this.pixels = Math.min(this.canvas.width / width, 900 / height);
      this.canvas.height = Math.ceil(height * this.pixels);
      this.x = (x) => (x - left + margin) * this.pixels;
      this.y = (y) => (top + margin - y) * this.pixels;
      this.back = (px, py) => [px / this.pixels + left - margin, top + margin - py / this.pixels];
    }
    draw(value, scale, isMarked, words) {
      const g = this.canvas.getContext("2d"), f = this.facade, n = f.points;
      g.clearRect(0, 0, this.canvas.width, this.canvas.height);
      const here = f.onSheet(this.number);
      for (const i of here) {
        g.fillStyle = g.strokeStyle = colour(scale.share(value(i)));
        g.beginPath();
        for (let k = 0; k < 8; k += 2)
          g.lineTo(this.x(f.tiles[k * n + i]), this.y(f.tiles[(k + 1) * n + i]));
        g.closePath();
        g.fill();
        g.stroke();
      }
      for (const i of here) if (isMarked(i)) this.ring(g, i, 3, INK, "#fff");
      for (const [kind, [stroke, width]] of Object.entries(OUTLINES))
        for (const line of f.sheets[this.number].outlines[kind] ?? []) this.outline(g, line, stroke, width, kind);
      this.plain = new OffscreenCanvas(this.canvas.width, this.canvas.height);
      this.plain.getContext("2d").drawImage(this.canvas, 0, 0);
      this.mark();
      this.canvas.setAttribute("aria-label", words);
    }
    mark() { // rings the chosen point
      const g = this.canvas.getContext("2d"), point = chosen[this.facade.index];
      g.clearRect(0, 0, this.canvas.width, this.canvas.height);
      g.drawImage(this.plain, 0, 0);
      if (point < 0 || this.facade.sheet[point] !== this.number) return;
      for (const [width, stroke] of [[6, "#fff"], [3, MARK]]) this.ring(g, point, 9, stroke, null, width);
    }
    outline(g, line, stroke, width, kind) {
      g.beginPath();
      for (let k = 0; k < line.length; k += 2) g.lineTo(this.x(line[k]), this.y(line[k + 1]));
      if (kind !== "glazing") g.closePath();
      if (kind === "furniture") {
        g.lineWidth = width + 1.5;
        g.strokeStyle = INK;
        g.stroke();
      }
      g.lineWidth = width;
      g.strokeStyle = stroke;
      g.stroke();
      g.lineWidth = 1;
    }
    ring(g, point, radius, stroke, fill, width = 1) {
      g.beginPath();
      g.arc(this.x(this.facade.x[point]), this.y(this.facade.y[point]), radius, 0, 2 * Math.PI);
      g.lineWidth = width;
      g.strokeStyle = stroke;
      if (fill) { g.fillStyle = fill; g.fill(); }
      g.stroke();
      g.lineWidth = 1;
    }
    choose(event, told) {
      const box = this.canvas.getBoundingClientRect(), zoom = this.canvas.width / box.width;
      const at = this.back((event.clientX - box.left) * zoom, (event.clientY - box.top) * zoom);
      choose(this.facade, this.facade.nearest(...at, this.number), told);
    }
    step(event) {
      const to = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      if (!to) return;
      event.preventDefault();
      const f = this.facade, from = chosen[f.index];
      let best = from, least = Infinity;
      for (const i of f.onSheet(this.number)) {
        const dx = f.x[i] - f.x[from], dy = f.y[i] - f.y[from];
        const along = dx * to[0] + dy * to[1], across = Math.abs(dx * to[1]) + Math.abs(dy * to[0]);
        if (along > 0 && across <= along && along + 2 * across < least) [best, least] = [i, along + 2 * across];
      }
      choose(f, best, true);
    }
  }

  class Year { // canvas with days across and hours up
    constructor(canvas, facade) {
      Object.assign(this, { canvas, facade });
      const dates = facade.times.map((time) => new Date(time));
      this.hour = dates.map((d) => d.getUTCHours() + d.getUTCMinutes() / 60);
      this.day = dates.map((d) => (Date.UTC(2001, d.getUTCMonth(), d.getUTCDate()) - Date.UTC(2001, 0)) / 864e5);
      this.left = 52;
      this.bottom = canvas.height - 30;
      this.low = Math.floor(this.hour.reduce((a, b) => Math.min(a, b), 24));
      this.high = Math.min(24, Math.ceil(this.hour.reduce((a, b) => Math.max(a, b), 0) + facade.step_hours));
      this.across = (canvas.width - this.left - 4) / 365;
      this.up = (this.bottom - 6) / (this.high - this.low);
      canvas.addEventListener("click", (event) => this.go(event));
    }
    x(day) { return this.left + day * this.across; }
    y(hour) { return this.bottom - (hour - this.low) * this.up; }
    draw(value, scale, words) {
      const g = this.canvas.getContext("2d"), { step_hours: step, hours } = this.facade;
      g.fillStyle = "#fff";
      g.fillRect(0, 0, this.canvas.width, this.canvas.height);
      const width = this.across * clamped(hours.days, 1, 31) + 0.4, height = step * this.up + 0.4;
      this.day.forEach((day, i) => {
        g.fillStyle = colour(scale.share(value(i)));
        g.fillRect(this.x(day), this.y(this.hour[i] + step), width, height);
      });
      g.fillStyle = INK;
      g.font = "18px sans-serif";
      g.textAlign = "left";
      t.js_months.split(" ").forEach((month, k) => g.fillText(month, this.x(k * 30.42 + 4), this.bottom + 22));
      g.textAlign = "right";
      const every = this.high - this.low > 12 ? 6 : 2;
      for (let h = this.low; h <= this.high; h += every) g.fillText(`${h} h`, this.left - 5, this.y(h) + 8);
      const now = this.facade.at.get(time());
      if (now !== undefined) {
        g.strokeStyle = MARK;
        g.lineWidth = 2;
        g.strokeRect(this.x(this.day[now]) - 3, this.y(this.hour[now] + step) - 2, width + 6, height + 4);
      }
      this.canvas.setAttribute("aria-label", words);
    }
    go(event) {
      const box = this.canvas.getBoundingClientRect(), zoom = this.canvas.width / box.width;
      const day = ((event.clientX - box.left) * zoom - this.left) / this.across;
      const hour = this.low + (this.bottom - (event.clientY - box.top) * zoom) / this.up;
      const away = this.day.map((d, i) => Math.abs(d + 0.5 - day) + Math.abs(this.hour[i] + 0.5 - hour));
      const nearest = this.facade.times[away.indexOf(Math.min(...away))];
      slider.value = times.indexOf(nearest);
      drawHour();
    }
  }

  class Domes { // canvas with the sky as a traced point sees it, by window
    constructor(canvas, facade) {
      Object.assign(this, { canvas, facade });
      this.patches = [];
      facade.lights.rows.forEach((count, row) => {
        const high = count === 1 ? Math.PI / 2 : (row + 1) * facade.lights.height, width = (2 * Math.PI) / count;
        for (let k = 0; k < count; k++)
          this.patches.push([row * facade.lights.height, high, (k - 0.5) * width, (k + 0.5) * width]);
      });
    }
    of(point) { // the traced point nearest to one of the plan
      const f = this.facade, away = (other) => Math.hypot(
        f.lights.x[other] - f.x[point], f.lights.y[other] - f.y[point]) / 1000;
      const every = f.lights.points.map((_, i) => i);
      const best = every.reduce((a, b) => (away(b) < away(a) ? b : a));
      return [f.lights.points[best], away(best)];
    }
    draw(point) {
      const g = this.canvas.getContext("2d"), { lights } = this.facade, [traced, away] = this.of(point);
      g.fillStyle = "#fff";
      g.fillRect(0, 0, this.canvas.width, this.canvas.height);
      const bins = lights.count + lights.suns.length / 2;
      traced.windows.forEach((window, column) => {
        for (const row of [0, 1])
          this.dome(g, 125 + 245 * column, 140 + 255 * row, 105, window.levels.slice(row * bins, (row + 1) * bins));
        g.fillStyle = INK;
        g.font = "17px sans-serif";
        g.textAlign = "center";
        [t.js_light_straight, t.js_light_reflected].forEach((word, row) =>
          g.fillText(`${window.name.slice(0, 18)}, ${word}`, 125 + 245 * column, 22 + 255 * row));
      });
      const parts = traced.windows.map((window) => filled(t.js_light_part, { window: window.name, share: window.share }));
      const words = filled(t.js_light, { number: traced.sensor, away: away.toFixed(2), parts: parts.join("; ") });
      $(`dome-map-text-${this.facade.index}`).textContent = words;
      this.canvas.setAttribute("aria-label", `${filled(t.light_of, { facade: this.facade.name })}: ${words}`);
    }
    dome(g, x, y, radius, levels) {
      const arc = (away, first, last, back) =>
        g.arc(x, y, away * radius, first - Math.PI / 2, last - Math.PI / 2, back);
      const fill = (level) => {
        g.fillStyle = g.strokeStyle = colour(level / 255);
        g.fill();
        g.stroke();
      };
      g.lineWidth = 0.6;
      g.beginPath();
      arc(1.1, 0, 2 * Math.PI);
      fill(levels[0]);
      this.patches.forEach(([low, high, first, last], i) => {
        const outer = 1 - low / (Math.PI / 2), inner = Math.max(1 - high / (Math.PI / 2), 0);
        g.beginPath();
        arc(outer, first, last);
        arc(inner, last, first, true);
        g.closePath();
        fill(levels[i + 1]);
      });
      const { suns, count } = this.facade.lights, half = suns.length / 2;
      for (let k = 0; k < half; k++) {
        const level = levels[count + k];
        g.fillStyle = level ? colour(level / 255) : "#5a5a5a";
        const size = level ? 3 : 1;
        g.fillRect(x + (radius * suns[k]) / 1000 - size / 2, y - (radius * suns[half + k]) / 1000 - size / 2, size, size);
      }
      g.strokeStyle = "#fff";
      g.lineWidth = 1;
      g.beginPath();
      arc(1, 0, 2 * Math.PI);
      g.stroke();
    }
  }

  if (typeof DecompressionStream === "undefined") {
    $("old").textContent = t.js_old;
    return;
  }
  await unpackedAll(facades);
  const all = facades.map((content, i) => new Facade(content, i));
  const timed = all.filter((f) => f.times);
  const times = timed.length ? timed[0].times : [];
  const slider = $("hour");
  const time = () => times[+slider.value];
  const sheetList = $("sheet");
  const most = all.reduce((a, b) => (b.sheets.length > a.sheets.length ? b : a));
  most.sheets.forEach((sheet, i) => sheetList.add(new Option(sheet.name, i)));
  const start = Array.from(all[0].enough, (n) => Math.abs(n - all[0].needed));
  const chosen = all.map(() => -1);
  const maps = all.map((f) => new Plan($(`plan-map-${f.index}`), f));
  const hourMaps = timed.map((f) => new Plan($(`hour-map-${f.index}`), f));
  const days = timed.map((f) => new Year($(`day-map-${f.index}`), f));
  const years = timed.map((f) => new Year($(`point-map-${f.index}`), f));

  const domes = all.filter((f) => f.lights?.points.length).map((f) => new Domes($(`dome-map-${f.index}`), f));
  const traced = $("traced");
  for (const { facade } of domes.slice(0, 1)) {
    facade.lights.points.forEach((point, i) => traced.add(new Option(
      filled(t.light_at, { number: point.sensor, x: facade.lights.x[i] / 1000, y: facade.lights.y[i] / 1000 }), i)));
    traced.addEventListener("change", () => {
      const at = +traced.value, shown = Array.from(facade.x.keys());
      const away = shown.map((i) => Math.hypot(facade.x[i] - facade.lights.x[at], facade.y[i] - facade.lights.y[at]));
      choose(facade, away.indexOf(away.reduce((a, b) => Math.min(a, b), Infinity)), true);
    });
  }

  const percent = (part, whole) => (100 * part) / whole;
  const QUANTITIES = {
    mean: { of: (f, i) => f.mean[i] / 10, scale: () => LUX },
    enough: {
      of: (f, i) => percent(f.enough[i], f.stamps),
      scale: () => linear(100, "%", percent(all[0].needed, all[0].stamps)),
    },
    in_sun: {
      of: (f, i) => f.in_sun[i] * f.step_hours,
      scale: () => linear(
        Math.max(...all.map((f) => f.in_sun.reduce((a, b) => Math.max(a, b), 2 * f.allowed) * f.step_hours)),
        "h", all[0].allowed * all[0].step_hours,
      ),
    },
    sDA: { of: (f, i) => f.probability.sDA[i] / 100, scale: () => linear(100, "%") },
    ASE: { of: (f, i) => f.probability.ASE[i] / 100, scale: () => linear(100, "%") },
  };
  const isOpen = (p) => p > 0 && p < 10000;

  function drawPlans() {
    const key = $("shown").value, quantity = QUANTITIES[key], scale = quantity.scale();
    const words = $("shown").selectedOptions[0].textContent;
    const metrics = { enough: ["sDA"], sDA: ["sDA"], in_sun: ["ASE"], ASE: ["ASE"] }[key] ?? [];
    for (const plan of maps) {
      const f = plan.facade;
      plan.lay(+sheetList.value);
      plan.draw(
        (i) => quantity.of(f, i), scale, (i) => metrics.some((m) => isOpen(f.probability[m][i])),
        filled(t.plan_of, { facade: f.name, quantity: words }),
      );
      $(`plan-map-text-${f.index}`).textContent =
        f.points < f.count ? filled(t.thinned, { shown: f.points, count: f.count }) : "";
    }
    drawScale($("plan-map-scale"), scale, words);
  }

  function timeText() {
    const date = new Date(time()), hour = date.toISOString().slice(11, 16);
    const month = t.js_months.split(" ")[date.getUTCMonth()];
    return filled(t.js_hour, { day: date.getUTCDate(), month, hour });
  }

  function drawHour() {
    if (!times.length) return;
    $("hour-text").textContent = timeText();
    slider.setAttribute("aria-valuetext", timeText());
    for (const plan of hourMaps) {
      const f = plan.facade, hour = f.at.get(time()), text = $(`hour-map-text-${f.index}`);
      plan.lay(+sheetList.value);
      if (hour === undefined) {
        plan.draw(() => 0, LUX, () => false, t.js_no_hour);
        text.textContent = t.js_no_hour;
        continue;
      }
      const words = filled(t.hour_of, { facade: f.name });
      plan.draw((i) => f.light(hour, i), LUX, (i) => f.inSun(hour, i), words);
      const mean = (f.hours.mean[hour] / 10).toFixed(0);
      const enough = percent(f.hours.enough[hour], f.points).toFixed(0);
      const states = f.hours.groups.map((group) =>
        filled(t.js_shade, { group: group.name, state: group.states[group.state[hour]] }));
      const numbers = filled(t.js_plan_hour, { mean, enough, threshold: f.sda_threshold });
      text.textContent = [numbers, ...states].join("; ");
    }
    drawScale($("hour-map-scale"), LUX, t.hour);
    drawDays();
    drawPoint();
  }

  const MAPPED = {
    mean: { of: (f, h) => f.hours.mean[h] / 10, scale: LUX },
    enough: { of: (f, h) => percent(f.hours.enough[h], f.points), scale: linear(100, "%") },
    in_sun: { of: (f, h) => percent(f.hours.in_sun[h], f.points), scale: linear(100, "%") },
    state: { of: (f, h) => f.closed(h), scale: { share: (v) => v, ticks: [0, 1], names: ["open", t.js_closed], unit: "" } },
  };

  function drawDays() {
    const { of, scale } = MAPPED[$("mapped").value], quantity = $("mapped").selectedOptions[0].textContent;
    for (const map of days)
      map.draw((h) => of(map.facade, h), scale, filled(t.map_of, { facade: map.facade.name, quantity }));
    drawScale($("day-map-scale"), scale, quantity);
  }

  function drawPoint() {
    if (chosen[0] < 0) return;
    for (const map of years) {
      const f = map.facade, i = chosen[f.index];
      map.draw((h) => f.light(h, i), LUX, filled(t.point_of, { facade: f.name }));
    }
    drawScale($("point-map-scale"), LUX, t.point);
    for (const dome of domes) dome.draw(chosen[dome.facade.index]);
    if (domes.length) {
      const first = domes[0].facade, [point] = domes[0].of(chosen[first.index]);
      traced.value = first.lights.points.indexOf(point);
    }
    for (const f of all) $(`point-map-text-${f.index}`).textContent = pointText(f);
  }

  function lightText(f, i) { // shares of the windows in the light of a point, the largest first
    const { windows, shares } = f.lit_by, words = t.js_light_parts.split(",");
    const of = windows.map((window, w) => {
      const parts = words.map((word, k) => [word, shares[(w * words.length + k) * f.points + i] / 10]);
      return { window, share: parts.reduce((sum, [, part]) => sum + part, 0), parts };
    });
    return of.filter(({ share }) => share >= 0.5).sort((a, b) => b.share - a.share)
      .map(({ window, share, parts }) => filled(t.js_light_window, {
        window, share: share.toFixed(1),
        parts: parts.filter(([, part]) => part >= 0.05).map(([word, part]) => `${word} ${part.toFixed(1)}`).join(", "),
      })).join("; ");
  }

  function pointText(f) {
    const i = chosen[f.index], text = numbersText(f, i);
    return f.lit_by ? filled(t.js_light_year, { text, parts: lightText(f, i) }) : text;
  }

  function numbersText(f, i) {
    return filled(t.js_point, {
      number: f.sensor[i], x: (f.x[i] / 1000).toFixed(2), y: (f.y[i] / 1000).toFixed(2),
      mean: (f.mean[i] / 10).toFixed(0), threshold: f.sda_threshold,
      enough: percent(f.enough[i], f.stamps).toFixed(1), sun: +(f.in_sun[i] * f.step_hours).toFixed(1),
      sda: f.probability.sDA[i] / 100, ase: f.probability.ASE[i] / 100,
    });
  }

  let isWaiting = false;
  function choose(facade, point, told) {
    if (point < 0 || (point === chosen[facade.index] && !told)) return;
    const sheet = facade.sheet[point];
    for (const f of all) {
      const other = f.nearest(facade.x[point], facade.y[point], Math.min(sheet, f.sheets.length - 1));
      chosen[f.index] = f === facade ? point : Math.max(other, 0);
    }
    if (told) $("point-live").textContent = `${facade.name}: ${pointText(facade)}`;
    if (isWaiting) return;
    isWaiting = true;
    requestAnimationFrame(() => {
      isWaiting = false;
      for (const plan of [...maps, ...hourMaps]) plan.mark();
      drawPoint();
    });
  }

  function byDays(sign) {
    const to = time() + sign * 864e5;
    const away = times.map((other) => (sign * (other - time()) > 0 ? Math.abs(other - to) : Infinity));
    const least = away.reduce((a, b) => Math.min(a, b), Infinity);
    if (least < Infinity) slider.value = away.indexOf(least);
    drawHour();
  }

  if (times.length) {
    slider.max = times.length - 1;
    const noon = times.map((v) => Math.abs(v - Date.UTC(new Date(times[0]).getUTCFullYear(), 2, 21, 12)));
    slider.value = noon.indexOf(noon.reduce((a, b) => Math.min(a, b), Infinity));
    const error = Math.max(...timed.map((f) => 50 * f.hours.step)), every = Math.max(...timed.map((f) => f.hours.days));
    $("hours-error").textContent = filled(t.hours_error, { error: +error.toFixed(1) }) +
      (every > 1 ? ` ${filled(t.hours_days, { days: every })}` : "");
    slider.addEventListener("input", drawHour);
    $("before").addEventListener("click", () => byDays(-1));
    $("after").addEventListener("click", () => byDays(1));
    $("mapped").addEventListener("change", drawDays);
  } else {
    $("hours-error").textContent = t.no_hours;
  }
  $("shown").addEventListener("change", drawPlans);
  const folded = [...document.querySelectorAll("details:not([open])")];
  addEventListener("beforeprint", () => folded.forEach((part) => { part.open = true; }));
  sheetList.addEventListener("change", () => { drawPlans(); drawHour(); });
  drawPlans();
  drawHour();
  choose(all[0], start.indexOf(start.reduce((a, b) => Math.min(a, b), Infinity)), true);
  requestAnimationFrame(() => { document.documentElement.dataset.ready = "yes"; });
})();
