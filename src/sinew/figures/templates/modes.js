// The shapes of modes, drawn on a canvas: silicone as a translucent skin, tendons in it, base, head plate and lever.
(() => {
  const read = (id) => JSON.parse(document.getElementById(id).textContent), $ = (id) => document.getElementById(id);
  const data = read("lines"), names = read("names"), canvas = $("joint"), pen = canvas.getContext("2d");
  const pose = $("pose"), mode = $("mode"), play = $("play"), yaw = $("yaw"), pitch = $("pitch");
  const still = matchMedia("(prefers-reduced-motion: reduce)"), dark = matchMedia("(prefers-color-scheme: dark)");
  const PERIOD_S = 2, LIGHT = [-0.5, -0.6, 0.62], BASE = 1.25, AROUND = 24, BETWEEN = 2;
  const cover = document.createElement("canvas"), brush = cover.getContext("2d");
  // Lines by part. Of the silicone the longest are rings, whose points stand evenly around, first and last the same.
  const starts = data.sizes.map(((sum) => (size) => (sum += size) - size)(0));
  const of = (part) => data.parts.flatMap((one, i) => one === part ? [i] : []);
  const round = Math.max(...data.sizes), silicone = of("silicone");
  const rings = silicone.filter((i) => data.sizes[i] === round), quarter = (round - 1) / 4;
  const tendons = of("tendon"), [plate] = of("plate"), lever = of("lever");
  // One scale and one middle for all shapes, so that nothing jumps from one to the next.
  let tall = 0, wide = 0;
  for (const { modes } of data.poses) for (const { at } of modes) for (const one of at) for (let k = 0; k < one.length; k += 3) {
    tall = Math.max(tall, one[k]); wide = Math.max(wide, Math.hypot(one[k + 1], one[k + 2]));
  }
  let moving = false, phase = 0.5, before = 0;

  // Points at a phase of the swing, along parabolas through both ends and rest.
  function shape(at, swing) {
    const [low, rest, high] = at;
    return rest.map((middle, k) => middle + swing * (high[k] - low[k]) / 2 + swing * swing * ((high[k] + low[k]) / 2 - middle));
  }

  // The skin of the silicone: rings of points (3) through those that are known, smooth along the rod by Catmull and Rom.
  function skin(flat) {
    const known = rings.map((i) => {
      const at = (k) => flat.slice(3 * (starts[i] + k), 3 * (starts[i] + k) + 3);
      const one = at(0), other = at(2 * quarter), centre = one.map((v, c) => (v + other[c]) / 2);
      return [centre, one.map((v, c) => v - centre[c]), at(quarter).map((v, c) => v - centre[c])];
    });
    const last = known.length - 1, found = [];
    for (let n = 0; n <= last * BETWEEN; n++) {
      const j = Math.min(Math.floor(n / BETWEEN), last - 1), t = n / BETWEEN - j;
      const four = [Math.max(j - 1, 0), j, j + 1, Math.min(j + 2, last)].map((m) => known[m]);
      const [centre, first, second] = [0, 1, 2].map((part) => [0, 1, 2].map((c) => {
        const [p, q, r, s] = four.map((ring) => ring[part][c]);
        return q + t / 2 * (r - p + t * (2 * p - 5 * q + 4 * r - s + t * (3 * (q - r) + s - p)));
      }));
      found.push(Array.from({ length: AROUND + 1 }, (_, k) => centre.map((v, c) =>
        v + Math.cos(2 * Math.PI * k / AROUND) * first[c] + Math.sin(2 * Math.PI * k / AROUND) * second[c])));
    }
    return found;
  }

  function draw() {
    const ratio = Math.min(2, devicePixelRatio || 1), width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
    }
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.lineJoin = pen.lineCap = "round";
    const style = getComputedStyle(document.documentElement), ink = (name) => style.getPropertyValue(name).trim();
    const { modes, slack } = data.poses[pose.value], at = modes[mode.value].at;
    const a = yaw.value * Math.PI / 180, b = pitch.value * Math.PI / 180;
    const scale = 0.92 * Math.min(width / 2 / wide, height / (tall * Math.cos(b) + 2 * wide * Math.abs(Math.sin(b))));
    // Right, down and towards the eye of a point of frame B, whose x points up.
    const eyed = ([up, y, z]) => {
      const x = up - tall / 2;
      const right = y * Math.cos(a) + z * Math.sin(a), near = y * Math.sin(a) - z * Math.cos(a);
      return [width / 2 + scale * right, height / 2 - scale * (x * Math.cos(b) - near * Math.sin(b)), scale * (x * Math.sin(b) + near * Math.cos(b))];
    };
    const seen = (flat) => Array.from({ length: flat.length / 3 }, (_, k) => eyed(flat.slice(3 * k, 3 * k + 3)));
    const line = (points, first, size, colour, wide, dash = []) => {
      pen.beginPath(); pen.setLineDash(dash);
      for (let k = first; k < first + size; k++) pen.lineTo(points[k][0], points[k][1]);
      pen.strokeStyle = colour; pen.lineWidth = wide; pen.stroke();
    };
    const disc = (points, colour, edge) => {
      pen.beginPath(); pen.setLineDash([]);
      for (const point of points) pen.lineTo(point[0], point[1]);
      pen.closePath(); pen.fillStyle = colour; pen.fill(); pen.strokeStyle = edge; pen.lineWidth = 2; pen.stroke();
    };
    const flat = shape(at, Math.sin(Math.PI * phase)), now = seen(flat), rest = seen(at[1]), tube = skin(flat).map((ring) => ring.map(eyed));
    const foot = tube[0].slice(1), middle = foot.reduce((sum, p) => sum.map((s, i) => s + p[i] / AROUND), [0, 0, 0]);
    const widened = (points, centre) => points.map((p) => p.map((v, i) => centre[i] + BASE * (v - centre[i])));
    const end = tube.at(-1).slice(1), top = end.reduce((sum, p) => sum.map((s, i) => s + p[i] / AROUND), [0, 0, 0]);
    const drawBase = () => disc(widened(foot, middle), ink("--card"), ink("--soft"));
    const drawHead = () => {
      disc(widened(end, top), ink("--card"), ink("--ink"));
      for (const i of lever) {
        line(now, starts[i], data.sizes[i], ink("--bad"), 5);
        if (i === lever[0]) for (const k of [0, data.sizes[i] - 1]) {
          pen.beginPath(); pen.arc(now[starts[i] + k][0], now[starts[i] + k][1], 0.05 * wide * scale, 0, 2 * Math.PI);
          pen.fillStyle = ink("--bad"); pen.fill();
        }
      }
    };
    // The skin is painted aside and laid over what is behind it as a whole, so that no seam shows; stripes tell its twist.
    const painted = (isNear, alpha) => {
      cover.width = canvas.width; cover.height = canvas.height;
      brush.setTransform(ratio, 0, 0, ratio, 0, 0);
      for (let r = 0; r + 1 < tube.length; r++) for (let k = 0; k < AROUND; k++) {
        const corners = [tube[r][k], tube[r][k + 1], tube[r + 1][k + 1], tube[r + 1][k]], [p, q, , s] = corners;
        const u = q.map((v, i) => v - p[i]), v = s.map((w, i) => w - p[i]);
        const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        const towards = n[2] > 0 ? 1 : -1, size = towards * (Math.hypot(...n) || 1);
        if ((n[2] < 0) !== isNear) continue; // corners run so that n points into the silicone
        const lit = Math.max(0, n.reduce((sum, value, i) => sum + value / size * LIGHT[i], 0));
        const shade = (dark.matches ? 90 + 120 * lit : 135 + 105 * lit) * (k % 6 === 0 ? 0.8 : 1);
        brush.beginPath();
        for (const [x, y] of corners) brush.lineTo(x, y);
        brush.closePath();
        brush.fillStyle = brush.strokeStyle = `rgb(${shade}, ${0.94 * shade}, ${0.8 * shade})`;
        brush.fill(); brush.stroke();
      }
      pen.globalAlpha = alpha;
      pen.drawImage(cover, 0, 0, width, height);
      pen.globalAlpha = 1;
    };
    const above = pitch.value >= 0;
    (above ? drawBase : drawHead)();
    disc(foot, dark.matches ? "rgb(110, 103, 88)" : "rgb(190, 178, 150)", "transparent");
    painted(false, 0.9);
    tendons.forEach((i, k) => line(now, starts[i], data.sizes[i], slack[k] ? ink("--bad") : ink("--accent"), 3, slack[k] ? [6, 5] : []));
    painted(true, 0.6);
    (above ? drawHead : drawBase)();
    for (const i of [plate, ...lever]) line(rest, starts[i], data.sizes[i], ink("--soft"), 1.2, [3, 4]);
  }

  function turn(at) {
    if (!moving) return;
    phase = (phase + Math.min(at - before, 100) / 1000 * 2 / PERIOD_S) % 2;
    before = at;
    draw();
    requestAnimationFrame(turn);
  }

  function set(isMoving) {
    play.textContent = isMoving ? "Pause" : "Play";
    if (isMoving === moving) return;
    moving = isMoving; before = performance.now();
    if (moving) requestAnimationFrame(turn); else draw();
  }

  function tell() {
    const [name, sentence] = names[pose.value][1][mode.value];
    $("told").textContent = sentence;
    canvas.setAttribute("aria-label", `The joint at ${names[pose.value][0]} swinging in its mode of ${name}`);
    draw();
  }

  function list() {
    const kept = Math.max(mode.selectedIndex, 0);
    mode.replaceChildren(...names[pose.value][1].map(([name], i) => new Option(name, i)));
    mode.selectedIndex = Math.min(kept, mode.options.length - 1);
    tell();
  }

  play.addEventListener("click", () => set(!moving));
  pose.addEventListener("change", list);
  mode.addEventListener("change", tell);
  for (const slider of [yaw, pitch]) slider.addEventListener("input", draw);
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    if (!event.buttons) return;
    yaw.value = (Number(yaw.value) - 0.4 * event.movementX + 540) % 360 - 180;
    pitch.value = Number(pitch.value) + 0.4 * event.movementY;
    draw();
  });
  dark.addEventListener("change", draw);
  still.addEventListener("change", () => set(!still.matches));
  new ResizeObserver(draw).observe(canvas);
  document.getElementById("moving").hidden = false;
  list();
  set(!still.matches);
})();
