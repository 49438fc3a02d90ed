// The shapes of modes, drawn on a canvas: silicone as a translucent skin, tendons in it, base, head plate and lever.
(() => {
  const read = (id) => JSON.parse(document.getElementById(id).textContent), $ = (id) => document.getElementById(id);
  const data = read("lines"), names = read("names"), canvas = $("joint"), pen = canvas.getContext("2d");
  const pose = $("pose"), mode = $("mode"), play = $("play"), yaw = $("yaw"), pitch = $("pitch");
  const still = matchMedia("(prefers-reduced-motion: reduce)"), dark = matchMedia("(prefers-color-scheme: dark)");
  const PERIOD_S = 2, LIGHT = [0.45, 0.75, 0.48], BASE = 1.25;
  // Lines by part: of the silicone rings are the longest, edges run along it.
  const starts = data.sizes.map(((sum) => (size) => (sum += size) - size)(0));
  const of = (part) => data.parts.flatMap((one, i) => one === part ? [i] : []);
  const round = Math.max(...data.sizes), silicone = of("silicone");
  const rings = silicone.filter((i) => data.sizes[i] === round), edges = silicone.filter((i) => data.sizes[i] !== round);
  const tendons = of("tendon"), [plate] = of("plate"), lever = of("lever");
  // One scale and one middle for all shapes, so that nothing jumps from one to the next.
  let tall = 0, wide = 0;
  for (const { modes } of data.poses) for (const { at } of modes) for (const one of at) for (let k = 0; k < one.length; k += 3) {
    tall = Math.max(tall, one[k]); wide = Math.max(wide, Math.hypot(one[k + 1], one[k + 2]));
  }
  const reach = 1.05 * Math.hypot(tall / 2, wide);
  let moving = false, phase = 0.5, before = 0;

  // Points at a phase of the swing, along parabolas through both ends and rest.
  function shape(at, swing) {
    const [low, rest, high] = at;
    return rest.map((middle, k) => middle + swing * (high[k] - low[k]) / 2 + swing * swing * ((high[k] + low[k]) / 2 - middle));
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
    const scale = Math.min(width, height) / 2 / reach, a = yaw.value * Math.PI / 180, b = pitch.value * Math.PI / 180;
    // Right, up and towards the eye of a point of frame B, whose x points up.
    const seen = (flat) => Array.from({ length: flat.length / 3 }, (_, k) => {
      const x = flat[3 * k] - tall / 2, y = flat[3 * k + 1], z = flat[3 * k + 2];
      const right = y * Math.cos(a) + z * Math.sin(a), near = y * Math.sin(a) - z * Math.cos(a);
      return [width / 2 + scale * right, height / 2 - scale * (x * Math.cos(b) - near * Math.sin(b)), x * Math.sin(b) + near * Math.cos(b)];
    });
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
    const swing = Math.sin(Math.PI * phase), now = seen(shape(at, swing)), rest = seen(at[1]);
    const foot = now.slice(starts[rings[0]], starts[rings[0]] + round), middle = foot.reduce((sum, p) => sum.map((s, i) => s + p[i] / round), [0, 0, 0]);
    const drawBase = () => disc(foot.map((p) => p.map((v, i) => middle[i] + BASE * (v - middle[i]))), ink("--card"), ink("--soft"));
    const drawHead = () => {
      disc(now.slice(starts[plate], starts[plate] + round), ink("--card"), ink("--ink"));
      for (const i of lever) line(now, starts[i], data.sizes[i], ink("--bad"), 5);
    };
    // Skin between neighbouring rings, what looks away first, and tendons between.
    const faces = [];
    for (let r = 0; r + 1 < rings.length; r++) for (let k = 0; k + 1 < round; k++) {
      const corners = [[r, k], [r, k + 1], [r + 1, k + 1], [r + 1, k]].map(([i, j]) => now[starts[rings[i]] + j]);
      const [p, q, , s] = corners, u = q.map((v, i) => v - p[i]), v = s.map((w, i) => w - p[i]);
      const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      const size = Math.hypot(...n) || 1, lit = Math.abs(n[0] * LIGHT[0] - n[1] * LIGHT[1] + n[2] * LIGHT[2]) / size;
      faces.push({ corners, isNear: n[2] > 0, lit, depth: corners.reduce((sum, c) => sum + c[2], 0) });
    }
    faces.sort((one, other) => one.depth - other.depth);
    const skin = (isNear) => {
      for (const face of faces.filter((one) => one.isNear === isNear)) {
        const shade = dark.matches ? 95 + 115 * face.lit : 150 + 95 * face.lit;
        pen.beginPath(); pen.setLineDash([]);
        for (const [x, y] of face.corners) pen.lineTo(x, y);
        pen.closePath();
        pen.fillStyle = `rgba(${shade}, ${0.94 * shade}, ${0.82 * shade}, ${isNear ? 0.55 : 0.8})`;
        pen.strokeStyle = pen.fillStyle; pen.lineWidth = 0.4; pen.fill(); pen.stroke();
      }
    };
    const above = pitch.value >= 0;
    (above ? drawBase : drawHead)();
    skin(false);
    tendons.forEach((i, k) => line(now, starts[i], data.sizes[i], slack[k] ? ink("--bad") : ink("--accent"), 2.2, slack[k] ? [5, 4] : []));
    skin(true);
    for (const i of edges) line(now, starts[i], data.sizes[i], "rgba(110, 90, 50, 0.55)", 1);
    for (const i of [...edges, plate, ...lever]) line(rest, starts[i], data.sizes[i], ink("--soft"), 0.8, [3, 4]);
    (above ? drawHead : drawBase)();
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
