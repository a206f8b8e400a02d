// The element of the page: it opens the page's own script in its place, and hands it what the server sends.
import { openPage } from "skein-page";

export default {
  template: "<div></div>",
  mounted() {
    this.page = openPage(this.$el, (events) => this.$emit("drawn", events));
  },
  unmounted() {
    this.page.close();
  },
  methods: {
    receive(update) {
      this.page.receive(JSON.parse(update));
    },
  },
};
