// The time of a recording, to be played and scrubbed; of a stored map, the age up to which cells are shown.
const by = (id) => document.getElementById(id);

export class Timeline {
  constructor(page) {
    this.page = page;
    this.clock = null; // the last CLOCK
    this.scrubbing = 0; // until when (ms) the slider is the hand's, not the clock's
    by("play").onclick = () => this.toggle();
    by("seek").oninput = ({ target }) => this.seek(Number(target.value));
    by("speed").onchange = ({ target }) => page.link.say({ speed: Number(target.value) });
  }

  hello({ shown, timeline }) {
    this.shown = shown;
    by("timeline").hidden = !timeline && shown !== "map";
    for (const id of ["play", "speed"]) by(id).hidden = !timeline;
    if (!timeline) this.clock = null;
  }

  hear(clock) {
    if (clock.at === 0 && this.clock && this.clock.at > 1) this.page.panel.clear();
    this.clock = clock;
    by("play").textContent = clock.playing ? "Pause" : "Play";
    by("seek").max = Math.max(clock.end, 0.05);
    if (performance.now() > this.scrubbing) by("seek").value = clock.at;
    const mapped = clock.done < 1 ? `, ${Math.round(clock.done * 100)} % mapped` : "";
    by("clock").textContent = `${clock.at.toFixed(1)} of ${clock.end.toFixed(1)} s${mapped}`;
    by("seek").setAttribute("aria-valuetext", `${clock.at.toFixed(1)} seconds`);
    if (clock.failure) {
      by("notice").textContent = clock.failure;
      by("notice").hidden = false;
      if (!this.page.pose) this.page.panel.state("stale", "no map", []);
    }
  }

  /** Oldest and newest second of a stored map's cells. */
  ages([oldest, newest]) {
    by("timeline").hidden = !(newest > oldest);
    Object.assign(by("seek"), { min: oldest, max: newest, step: 1 });
    by("seek").value = newest;
    this.shownUntil(newest);
  }

  shownUntil(second) {
    by("clock").textContent = `seen until ${new Date(second * 1000).toISOString().slice(0, 19).replace("T", " ")}`;
  }

  toggle() {
    if (!this.clock) return;
    const ended = this.clock.done >= 1 && this.clock.at >= this.clock.end;
    this.page.link.say({ playing: !this.clock.playing, ...(ended ? { seek: 0 } : {}) });
  }

  seek(to) {
    by("seek").value = to;
    if (this.shown === "map") {
      this.page.map.show({ until: to < this.page.map.seen[1] ? to : Infinity });
      this.page.dirty = true;
      return this.shownUntil(to);
    }
    this.scrubbing = performance.now() + 400;
    this.page.link.say({ seek: to });
  }

  step(seconds) {
    if (this.clock) this.seek(Math.min(Math.max(this.clock.at + seconds, 0), this.clock.end));
  }
}
