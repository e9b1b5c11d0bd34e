// Shows a plan in the course of its time.

import { say } from './element.js';

export class Play {
  // `show` is called with a time; `begins` and `ends` when somebody begins to look at it, and has looked.
  constructor({ button, slider, now }, isCalm, { show, begins, ends }) {
    Object.assign(this, { button, slider, now, show, ends, begins, isOn: false, duration: 0 });
    // Who asks for less motion moves the slider.
    button.hidden = isCalm;
    button.onclick = () => (this.isOn ? this.stop() : this.start());
    slider.oninput = () => {
      this.stop();
      this.begins();
      this.to(slider.valueAsNumber);
    };
    slider.onchange = () => this.ends();
    this.describe(0);
  }

  // Takes another plan.
  describe(duration) {
    if (this.isOn) this.stop();
    this.duration = duration;
    Object.assign(this.slider, { max: duration, disabled: !duration });
    this.button.disabled = !duration;
    this.tell();
  }

  start() {
    this.begins();
    this.isOn = true;
    say(this.button, 'Stop');
    const before = this.slider.valueAsNumber < this.duration - 0.01 ? this.slider.valueAsNumber : 0;
    const begun = performance.now();
    const turn = now => {
      if (!this.isOn) return;
      const time = Math.min(before + Math.max(now - begun, 0) / 1000, this.duration);
      this.slider.value = time;
      this.to(time);
      if (time < this.duration) requestAnimationFrame(turn);
      else this.stop();
    };
    requestAnimationFrame(turn);
  }

  stop() {
    if (!this.isOn) return;
    this.isOn = false;
    say(this.button, 'Play');
    this.ends();
  }

  to(time) {
    this.tell();
    this.show(time);
  }

  tell() { say(this.now, this.duration ? `${this.slider.valueAsNumber.toFixed(2)} of ${this.duration.toFixed(2)} s` : ''); }
}
