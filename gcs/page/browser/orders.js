// The operator's orders: the flight says in numbers what one would do, and gives it once that is confirmed.

const ORDERS = ["hold", "land", "return", "continue"];

export class Orders {
  constructor(element, ticked) {
    this.ticked = ticked;
    element.innerHTML = `
      <div class="orders" role="group" aria-label="orders">
        <span class="whom">orders to all</span>
        ${ORDERS.map((order) => `<button data-order="${order}">${order} …</button>`).join("")}
        <output aria-live="polite"></output>
      </div>
      <dialog aria-label="confirm the order">
        <p></p>
        <button class="give">give this order</button> <button class="cancel" autofocus>cancel</button>
      </dialog>`;
    this.dialog = element.querySelector("dialog");
    this.result = element.querySelector("output");
    this.whom = element.querySelector(".whom");
    for (const button of element.querySelectorAll("[data-order]")) {
      button.onclick = () => this.ask(button.dataset.order);
    }
    element.querySelector(".cancel").onclick = () => this.dialog.close();
    element.querySelector(".give").onclick = () => this.give();
  }

  // Say to whom the next order goes.
  name() {
    const ticked = this.ticked();
    this.whom.textContent = ticked.length ? `orders to ${ticked.join(", ")}` : "orders to all";
  }

  async ask(order) {
    const { may, text, number } = await post({ order, vehicles: this.ticked() });
    this.result.textContent = may ? "" : text;
    if (!may) return;
    this.said = number;
    this.dialog.querySelector("p").textContent = text;
    this.dialog.showModal();
  }

  async give() {
    this.dialog.close();
    const { text } = await post({ confirms: this.said });
    this.result.textContent = text;
  }

}

// Ask the flight something, and return its answer.
export async function post(asked) {
  try {
    const answer = await fetch("/orders", { method: "POST", body: JSON.stringify(asked) });
    if (answer.ok) return await answer.json();
    return { may: false, text: `refused: ${(await answer.text()) || answer.status}` };
  } catch {
    return { may: false, text: "the page has no connection" };
  }
}
