// The operator's page: shows what the console process sends, and sends back what the operator asks.
// The server sends one message, waits until the page says "seen", and then sends the newest: a page that is
// slow or asleep misses states, and nothing waits for it anywhere.
import { Scene, HoldButton, age, joules, metres, clock } from "labr-page";

const STALE_S = 0.5; // older than this, what the page shows may no longer be true: driving is locked
const ABORT_HOLD_S = 0.6;
const SLIP_S = 0.5; // a second tap so soon is a glove's
const STOPS = new Set(["abort", "land", "pause"]); // these count at any time
const LINK_NAMES = { vio: "VIO", depth: "Depth", air: "Autopilot", stm32: "STM32", plan: "Planner" };
const MODES = {
  LAND: ["land", "◉ ◉"], AIR: ["air", "✛"], TRANSITION: ["between", "⇅"], HOLD: ["hold", "❚❚"], OVER: ["over", "■"],
};

export default {
  components: { HoldButton },
  template: `
  <div class="cockpit" :class="{'is-live': !!state}">
    <section v-if="access === 'refused'" class="panel notice" role="alert">
      <h1>This link is not valid</h1>
      <p>The token in the address is missing or wrong. Open the whole address that <code>labr-mission</code>
        printed when it started, with the part after <code>#</code>.</p>
    </section>
    <section v-else-if="!state" class="panel notice" role="status">
      <h1>{{ facts ? facts.mission : 'LABR console' }}</h1>
      <p>{{ access === 'open' ? words : 'Connecting ...' }}</p>
    </section>
    <template v-else>
      <header class="top" :class="'is-' + modeLook[0]">
        <div class="mode" role="status" aria-live="polite" :aria-label="'mode ' + modeWord">
          <span class="glyph" aria-hidden="true">{{ modeLook[1] }}</span><b>{{ modeWord }}</b>
        </div>
        <div class="why" role="status" aria-live="polite">
          <b>{{ state.why }}</b>
          <small>{{ facts?.mission }} &middot; step {{ Math.min(state.leg + 1, stepsTotal) }} of
            {{ stepsTotal }} &middot; {{ time }}</small>
        </div>
        <button type="button" class="ghost theme" @click="turnTheme"
          :aria-label="'colours: ' + theme + '; press to change'">{{ {auto: '◐', light: '☀', dark: '☾'}[theme] }}</button>
        <hold-button class="abort" v-if="!facts.replay" label="ABORT" sub="hold, or hold Esc" :seconds="abortHold"
          :disabled="role !== 'operator' || over || state.stage === 'ending'" @held="ask('abort')" aria-label="abort: hold to land and end the mission"/>
      </header>

      <section class="links panel" aria-label="age of each link">
        <div v-for="link in links" :key="link.name" class="link" :class="{late: link.late}" :data-link="link.key">
          <span>{{ link.name }}</span><b>{{ link.text }}</b><small>{{ link.late ? 'STALE' : 'fresh' }}</small>
        </div>
        <p class="lock" :class="{on: lock}" role="status" aria-live="assertive" v-if="!facts.replay">
          <b>{{ lock ? '✗ Driving is locked.' : ended ? 'Over.' : '✓ Driving is not locked.' }}</b>
          {{ lock || (ended ? '' : 'All links are fresh.') }}</p>
      </section>

      <section class="panel act" aria-label="what to do">
        <template v-if="facts.replay">
          <h2>Replay of {{ facts.run }}</h2>
          <input type="range" min="0" :max="replay.length_s" step="0.1" :value="replay.at_s" class="scrub"
            aria-label="place in the recording" @input="seek($event.target.value)">
          <div class="buttons transport">
            <button type="button" @click="play('step', -1)" aria-label="one step back">◀ step</button>
            <button type="button" class="strong" @click="play(replay.playing ? 'pause' : 'play')">
              {{ replay.playing ? '❚❚ Pause' : '▶ Play' }}</button>
            <button type="button" @click="play('step', 1)" aria-label="one step on">step ▶</button>
          </div>
          <div class="buttons speeds" role="group" aria-label="speed">
            <button type="button" v-for="s in [1, 2, 5, 10]" :key="s" @click="play('speed', s)"
              :aria-pressed="replay.speed === s" :class="{on: replay.speed === s}">{{ s }}x</button>
          </div>
          <p class="fine">{{ replay.at_s.toFixed(1) }} s of {{ replay.length_s.toFixed(1) }} s</p>
        </template>
        <template v-else>
          <div class="control" :class="{mine: holds}">
            <span v-if="ended">The mission is over. Its report is in {{ facts.run }}</span>
            <span v-else-if="role === 'viewer'">You are watching: this address is for viewers</span>
            <span v-else-if="holds"><b>✓ You have control</b> (page {{ page }})</span>
            <span v-else-if="state.control.holder">Page {{ state.control.holder }} has control; you watch
              (page {{ page }})</span>
            <span v-else>Nobody has control; you watch (page {{ page }})</span>
            <button type="button" v-if="role === 'operator' && !ended" class="take"
              @click="ask(holds ? 'release' : 'take')">{{ holds ? 'Give back' : 'Take control' }}</button>
          </div>
          <div class="buttons" v-if="role === 'operator' && !ended">
            <hold-button v-if="state.stage === 'waiting'" class="strong start" label="▶ Start" sub="hold"
              :disabled="!drives" @held="ask('start')"/>
            <button type="button" v-else-if="state.stage === 'paused'" class="strong" :disabled="!drives"
              @click="ask('resume')">▶ Resume</button>
            <button type="button" v-else class="strong" :disabled="!holds || over || state.stage !== 'running'"
              @click="ask('pause')">❚❚ Pause</button>
            <button type="button" :disabled="!drives || !begun" @click="ask('skip')">⇥ Skip step</button>
            <button type="button" :disabled="!drives || !begun" @click="ask('return')">⌂ Return</button>
            <button type="button" :disabled="!holds || !begun" @click="ask('land')">⤓ Land now</button>
            <button type="button" :disabled="!drives || !begun" :aria-pressed="picking" :class="{on: picking}"
              @click="pickMode">⊕ Go to ...</button>
          </div>
          <form v-if="picking" class="pick" @submit.prevent="go">
            <p>Tap the place in the 3D view, or type it.</p>
            <label>x <input v-model.number="pick.x" aria-label="x in metres" type="number" step="any" required @input="mark"> m</label>
            <label>y <input v-model.number="pick.y" aria-label="y in metres" type="number" step="any" required @input="mark"> m</label>
            <label>height <select v-model="pick.z"><option :value="null">on the floor</option>
              <option v-for="h in heights" :key="h" :value="h">{{ h }} m, flown</option></select></label>
            <button type="submit" class="strong" :disabled="!drives || pick.x === null || pick.y === null">Go</button>
            <button type="button" @click="pickMode">Cancel</button>
          </form>
          <p class="answer" role="status" aria-live="polite" :class="{bad: answer && answer.verdict === 'refused'}">
            {{ answerWords }}</p>
        </template>
      </section>

      <section class="panel next" aria-label="next goal">
        <h2>Next goal</h2>
        <p class="figure"><b>{{ state.goal ? metres(state.goal.distance_m) : '–' }}</b>
          <span>{{ state.goal ? state.goal.label + (state.goal.air ? ', in the air' : '') : 'none' }}</span></p>
        <p class="fine">{{ motion }}</p>
      </section>

      <section class="panel energy" aria-label="energy">
        <h2>Energy</h2>
        <p class="figure"><b>{{ joules(state.energy.left_j) }}</b><span>left above the reserve</span></p>
        <div class="bar" role="img" :aria-label="joules(state.energy.needed_j) + ' needed of ' + joules(state.energy.left_j)">
          <i :style="{width: share + '%'}" :class="{bad: share >= 100}"></i></div>
        <p class="fine"><b :class="{bad: share >= 100}">{{ joules(state.energy.needed_j) }} needed</b> to finish, at least
          ({{ state.energy.left_j === null ? '?' : share < 1 ? '<1' : Math.round(share) }} %) &middot; {{ joules(state.energy.used_j) }} used &middot;
          {{ state.energy.power_w }} W &middot; {{ state.energy.voltage_v?.toFixed(1) }} V</p>
      </section>

      <section class="panel view" aria-label="3D view">
        <div class="canvas" ref="canvas" tabindex="0" role="img"
          aria-label="map with robot, path, key points, goals and fence; coordinates can be typed under Go to"></div>
        <div class="looks">
          <button type="button" @click="look('robot')">Follow</button>
          <button type="button" @click="look('over')">Whole</button>
          <button type="button" @click="look('top')">Top</button>
        </div>
        <p class="legend fine"><span class="k land">● driven to</span> <span class="k air">▲ flown to</span>
          <span class="k path">▬ trajectory</span>
          <span class="mu" v-if="state.plan" :class="{bad: state.plan.mu >= state.plan.mu_limit}">μ
            {{ state.plan.mu?.toFixed(2) }} {{ state.plan.mu >= state.plan.mu_limit ? '≥' : '<' }}
            {{ state.plan.mu_limit }} &middot; follows {{ state.plan.source }}</span></p>
      </section>

      <section class="panel depth" aria-label="depth image">
        <h2>Depth <small v-if="depth">{{ depth.age_words }}</small></h2>
        <div class="picture" v-if="depth">
          <img :src="'data:image/jpeg;base64,' + depth.jpeg" alt="depth image: near is bright, far is dark">
          <svg :viewBox="'0 0 ' + depth.width + ' ' + depth.height" aria-hidden="true">
            <polyline :points="depth.points.map(p => p[0] + ',' + p[1]).join(' ')"/>
            <template v-for="(p, i) in depth.points" :key="i">
              <circle v-if="!p[2]" :cx="p[0]" :cy="p[1]" r="7" class="land"/>
              <path v-else :d="'M' + p[0] + ' ' + (p[1] - 9) + 'l9 16h-18z'" class="air"/>
            </template>
          </svg>
        </div>
        <p v-else class="fine">no image</p>
      </section>

      <section class="panel steps" aria-label="mission steps">
        <h2>Mission <small v-if="state.steps.length < stepsTotal">steps {{ stepsFirst + 1 }} to
          {{ stepsFirst + state.steps.length }} of {{ stepsTotal }}</small></h2>
        <ol><li v-for="(s, i) in state.steps" :key="i" :class="s.state" :aria-current="s.state === 'now' ? 'step' : null">
          <span aria-hidden="true">{{ {done: '✓', now: '▶', next: '○', failed: '✗'}[s.state] }}</span>
          {{ s.label }} <small>{{ s.state === 'next' && ended ? 'not done' : s.state }}</small></li></ol>
      </section>

      <section class="panel events" aria-label="timeline of events">
        <h2>Timeline</h2>
        <p v-if="!state.events.length" class="fine">nothing has happened yet</p>
        <ol reversed><li v-for="e in [...state.events].reverse()" :key="e[0]">
          <time>{{ e[1] < 0 ? '–' : clock(e[1]) }}</time> {{ e[2] }}</li></ol>
      </section>

      <section class="panel checks" aria-label="pre-flight checks">
        <h2>Checks <small>{{ failed.length ? failed.length + ' failed' : 'all ' + state.checks.length + ' passed' }}{{ begun || over ? ' at the start' : '' }}</small></h2>
        <ul><li v-for="c in sortedChecks" :key="c[0]" :class="{bad: !c[1]}">
          <span aria-hidden="true">{{ c[1] ? '✓' : '✗' }}</span><b>{{ c[0] }}</b> <span>{{ c[2] }}</span>
          <em v-if="c[3]">{{ c[1] ? '' : 'Fix: ' }}{{ c[3] }}</em></li></ul>
      </section>
    </template>
  </div>`,

  data: () => ({
    access: "asking", role: "", page: "", words: "Waiting for the flight ...", facts: null, state: null, over: false,
    depth: null, replay: null, now_s: 0, received_s: 0, sequence: 0, going: 0, askedMs: -1e9, answer: null, answered: 0,
    picking: false, pick: { x: null, y: null, z: null }, theme: "auto", abortHold: ABORT_HOLD_S,
  }),

  computed: {
    silent_s() { // since the state that is shown was true, as far as this page can know
      return this.facts?.replay || !this.state ? 0 : this.late_s + this.now_s - this.received_s;
    },
    lock() {
      if (this.over || this.facts.replay) return "";
      if (this.silent_s > STALE_S) return `The robot was last heard ${age(this.silent_s)} ago (limit ${STALE_S} s).`;
      return this.state.locked;
    },
    holds() { return this.role === "operator" && this.state.control.holder === this.page; },
    drives() { return this.holds && !this.lock && !this.over && this.state.stage !== "ending"; },
    begun() { return ["running", "paused"].includes(this.state.stage) && !this.over; },
    ended() { return this.over || !!this.state.outcome; },
    modeWord() { return this.ended ? "OVER" : this.state.mode; },
    modeLook() { return MODES[this.modeWord] || MODES.HOLD; },
    time() { return clock(this.state.time_s); },
    stepsFirst() { return this.state.steps_first ?? 0; }, // a long mission is shown around the present step
    stepsTotal() { return this.state.steps_total ?? this.state.steps.length; },
    links() {
      const extra = Math.max(0, this.silent_s);
      const rows = Object.entries(this.state.links).map(([key, link]) => {
        const s = link.age_s === null ? null : link.age_s + (this.over ? 0 : extra);
        return { key, name: LINK_NAMES[key] || key, text: age(s), late: !this.over && (s === null || s > link.limit_s) };
      });
      if (!this.facts.replay && !this.over) {
        rows.push({ key: "console", name: "This page", text: age(extra), late: !this.over && extra > STALE_S });
      }
      return rows;
    },
    share() {
      const { left_j, needed_j } = this.state.energy;
      return !left_j ? (needed_j ? 100 : 0) : Math.min(100, (100 * (needed_j || 0)) / left_j);
    },
    motion() {
      const p = this.state.pose;
      if (!p) return "no pose";
      return `at (${p.position_m[0].toFixed(1)}, ${p.position_m[1].toFixed(1)}) · ${p.height_m.toFixed(2)} m above the floor · ${p.speed_mps.toFixed(2)} m/s`;
    },
    failed() { return this.state.checks.filter((c) => !c[1]); },
    sortedChecks() { return [...this.failed, ...this.state.checks.filter((c) => c[1])]; },
    heights() { return [0.8, 1.2, 1.6, 2.0].filter((h) => h <= (this.facts?.height_max_m || 0)); },
    answerWords() {
      const a = this.answer;
      if (!a) return "";
      if (a.verdict === "refused") return `✗ ${a.kind} refused: ${a.reason}`;
      return { sent: `… ${a.kind}`, asked: `… ${a.kind}: looking for a way`, accepted: `✓ ${a.kind}` }[a.verdict];
    },
  },

  created() {
    this.late_s = 0;
    this.timings = []; // for benchmarks: how old each state was when it had been drawn
  },

  mounted() {
    document.getElementById("boot")?.remove();
    this.theme = localStorage.getItem("labr-theme") || "auto";
    this.dark = window.matchMedia("(prefers-color-scheme: dark)");
    this.dark.addEventListener("change", this.paint);
    this.paint();
    this.ticker = setInterval(() => (this.now_s = performance.now() / 1000), 100);
    window.addEventListener("keydown", this.escape);
    window.addEventListener("keyup", this.escape);
    window.labr = this;
    this.hello();
  },

  unmounted() {
    clearInterval(this.ticker);
    window.removeEventListener("keydown", this.escape);
    window.removeEventListener("keyup", this.escape);
    this.scene?.dispose();
  },

  methods: {
    age, joules, metres, clock,

    // ---- access
    hello() {
      const found = /(?:^|&)t=([\w-]+)/.exec(window.location.hash.slice(1));
      if (found) sessionStorage.setItem("labr-token", found[1]);
      // the token is taken out of sight, so that it is neither photographed nor bookmarked
      if (found) history.replaceState(null, "", window.location.pathname);
      this.$emit("hello", { token: sessionStorage.getItem("labr-token") || "" });
    },
    welcome(message) {
      Object.assign(this, { access: message.role ? "open" : "refused", role: message.role, page: message.page });
      if (!message.role) sessionStorage.removeItem("labr-token");
    },

    // ---- what comes in
    show(message) {
      this.received_s = this.now_s = performance.now() / 1000;
      this.late_s = message.late_s || 0;
      if (message.words) this.words = message.words;
      if (message.facts) this.facts = message.facts;
      if (message.state) this.state = message.state;
      if (message.replay) this.replay = message.replay;
      this.over = !!message.over;
      if (message.depth !== undefined) this.depth = message.depth;
      if (message.state) this.matchAnswers(message.state.control.answers);
      this.$nextTick(() => {
        if (message.true_utc_s) {
          this.timings.push(Date.now() / 1000 - message.true_utc_s);
          if (this.timings.length > 3000) this.timings.shift();
        }
        this.$emit("seen", { number: message.number });
        this.drawScene(message);
      });
    },
    drawScene(message) {
      if (!this.state || !this.$refs.canvas || this.noScene) return;
      if (!this.scene) {
        try {
          this.scene = new Scene(this.$refs.canvas, this.picked);
        } catch (error) { // a browser without WebGL: everything but the 3D view works
          this.noScene = true;
          this.$refs.canvas.textContent = "This browser shows no 3D.";
          return;
        }
        this.scene.theme(this.isDark() ? "dark" : "light");
        if (this.facts) this.scene.setFacts(this.facts);
      } else if (message.facts) this.scene.setFacts(message.facts);
      if (message.map) this.scene.setMap(floats(message.map.cells), floats(message.map.trail));
      if (message.state) this.scene.setState(message.state);
    },
    matchAnswers(answers) {
      const mine = answers.filter((a) => a[0] === this.page).sort((a, b) => a[1] - b[1]).pop();
      if (mine && mine[1] === this.sequence) {
        this.answer = { sequence: mine[1], kind: mine[2], verdict: mine[3], reason: mine[4] };
        if (mine[1] === this.going && mine[3] === "accepted") this.pickMode();
      }
    },

    // ---- what goes out
    ask(kind, goal_m) {
      this.sequence += 1;
      const slip = !STOPS.has(kind) && performance.now() - this.askedMs < 1000 * SLIP_S;
      const reason = slip ? `a second tap within ${SLIP_S} s does not count` : "";
      this.answer = { sequence: this.sequence, kind, verdict: slip ? "refused" : "sent", reason };
      if (slip) return;
      this.askedMs = performance.now();
      // dated on the robot's clock as this page knows it: behind by as long as a state takes to get here, so
      // that a slow way here counts as much as a slow way back
      const stamp_s = this.state.stamp_s + performance.now() / 1000 - this.received_s;
      this.$emit("ask", { sequence: this.sequence, kind, stamp_s, goal_m: goal_m || null });
    },
    pickMode() {
      this.picking = !this.picking;
      this.going = 0;
      this.pick = { x: null, y: null, z: null };
      this.scene?.setPick(null);
    },
    picked([x, y]) {
      if (!this.picking) return;
      Object.assign(this.pick, { x: Math.round(x * 100) / 100, y: Math.round(y * 100) / 100 });
      this.mark();
    },
    mark() {
      const { x, y } = this.pick;
      if (typeof x === "number" && typeof y === "number") this.scene?.setPick([x, y]);
    },
    go() {
      this.ask("goto", [this.pick.x, this.pick.y, this.pick.z]);
      this.going = this.sequence; // the form stays until it is accepted, so that a place refused can be mended
    },
    escape(event) {
      if (event.key !== "Escape" || event.repeat) return;
      clearTimeout(this.escapeTimer);
      if (event.type === "keydown" && this.role === "operator" && !this.facts?.replay && this.state) {
        this.escapeTimer = setTimeout(() => this.ask("abort"), 1000 * ABORT_HOLD_S);
      }
    },
    play(command, value) { this.$emit("replay", { command, value: value ?? null }); },
    seek(value) {
      this.replay.at_s = Number(value);
      this.play("seek", Number(value));
    },

    // ---- looks
    look(how) { this.scene?.look(how); },
    isDark() { return this.theme === "dark" || (this.theme === "auto" && this.dark.matches); },
    paint() {
      document.documentElement.dataset.theme = this.isDark() ? "dark" : "light";
      this.scene?.theme(this.isDark() ? "dark" : "light");
    },
    turnTheme() {
      this.theme = { auto: "light", light: "dark", dark: "auto" }[this.theme];
      localStorage.setItem("labr-theme", this.theme);
      this.paint();
    },
  },
};

function floats(base64) {
  const raw = atob(base64), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return new Float32Array(bytes.buffer);
}
