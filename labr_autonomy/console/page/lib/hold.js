// A button that acts when it was held: by finger, mouse, or Space/Enter. A slip of a glove does nothing.
export const HoldButton = {
  props: { label: String, sub: String, seconds: { type: Number, default: 0.7 }, disabled: Boolean },
  emits: ["held"],
  template: `
    <button type="button" class="hold" :class="{holding: since !== null}" :disabled="disabled"
        :style="{'--hold': seconds + 's'}" @pointerdown.prevent="press" @pointerup="release"
        @pointercancel="release" @pointerleave="release" @contextmenu.prevent
        @keydown.space.prevent="key" @keydown.enter.prevent="key" @keyup="release" @blur="release">
      <span class="hold-bar" aria-hidden="true"></span>
      <span class="hold-text"><b>{{ label }}</b><small v-if="sub">{{ sub }}</small></span>
    </button>`,
  data: () => ({ since: null, timer: null }),
  methods: {
    press(event) {
      if (event.button > 0) return;
      this.$el.focus();
      this.begin();
    },
    key(event) {
      if (!event.repeat) this.begin();
    },
    begin() {
      if (this.disabled || this.timer !== null) return;
      this.since = performance.now();
      this.timer = setTimeout(() => {
        this.release();
        this.$emit("held");
      }, this.seconds * 1000);
    },
    release() {
      clearTimeout(this.timer);
      this.timer = null;
      this.since = null;
    },
  },
  watch: {
    disabled(now) {
      if (now) this.release();
    },
  },
};
