// The log of events with their times: those to come are pale, a click goes to one.

const WHO = { 0: "all vehicles", "-1": "this program" };

export class EventLog {
  constructor(element, scene, onTime) {
    this.scene = scene;
    this.onTime = onTime;
    this.lines = [];
    this.list = document.createElement("ol");
    const choice = document.createElement("label");
    choice.innerHTML = '<input type="checkbox"> only incidents and orders';
    choice.firstChild.onchange = ({ target }) => this.list.classList.toggle("only-bad", target.checked);
    element.append(choice, this.list);
    this.update();
  }

  // Add the lines of events that came since.
  update() {
    for (const event of this.scene.events.slice(this.lines.length)) {
      const line = document.createElement("li");
      const when = event.t_s === null ? "before T0" : `${event.t_s.toFixed(1)} s`;
      const time = document.createElement("button");
      time.textContent = when;
      time.disabled = event.t_s === null;
      time.onclick = () => this.onTime(event.t_s);
      line.append(time, ` ${WHO[event.sysid] ?? `vehicle ${event.sysid}`} ${event.text}`);
      line.classList.toggle("bad", event.is_bad);
      this.list.append(line);
      this.lines.push(line);
    }
  }

  // Pale what comes after a time, and keep the last event before it in sight.
  show(t) {
    const past = this.scene.events.filter((event) => event.t_s === null || event.t_s <= t + 1e-6).length;
    if (past === this.past) return;
    this.past = past;
    this.lines.forEach((line, n) => line.classList.toggle("later", n >= past));
    const last = this.lines[Math.max(past - 1, 0)];
    if (last) this.list.scrollTop = last.offsetTop - this.list.offsetTop - this.list.clientHeight + last.offsetHeight + 4;
  }
}
