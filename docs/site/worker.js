// Words of a message are not what a search takes by itself: short ones would be beginnings of any word, quotation marks
// and hyphens would mean something, and names, numbers and paths are nowhere on these pages. What is pasted is reduced to
// its words and looked for among the messages; a question loses its small words.
const COMMON = "about after and another any are back been beside but can could does for from get has have here how its many more must need not one only our out own should that the their them then there they this use want was were what when where which why with without you your error".split(" ");
const asWords = (query) => {
  const words = query.split(/\s+/).map((word) => word.replace(/^\W+|\W+$/g, ""));
  if (words.length < 4) return query;
  const kept = words.filter((word) => /^[a-z][a-z'-]{2,}$/i.test(word) && !COMMON.includes(word.toLowerCase()));
  if (!kept.length) return query;
  const message = /[:;,`'"/()\d]/.test(query);
  if (!message) return kept.join(" ");
  return ["+text:highfivemessages^1", ...kept.map((word) => `text:${word.replace(/[-'].*/, "")}^1`)].join(" ");
};
const asQuery = (data) => (data && data.type === 2 ? { ...data, data: asWords(data.data) } : data);

// Browsers start no worker of a page that was opened from a file. The search's script then runs in a hidden frame.
if (location.protocol === "file:")
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.waiting = [];
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.documentElement.append(frame);
      this.inside = frame.contentWindow;
      this.inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      const script = frame.contentDocument.createElement("script");
      script.src = url;
      script.onload = () => {
        const waiting = this.waiting;
        this.waiting = null;
        waiting.forEach((data) => this.postMessage(data));
      };
      frame.contentDocument.head.append(script);
    }
    postMessage(data) {
      if (this.waiting) this.waiting.push(data);
      else this.inside.dispatchEvent(new this.inside.MessageEvent("message", { data: asQuery(data) }));
    }
  };
else
  window.Worker = class extends window.Worker {
    postMessage(data) {
      super.postMessage(asQuery(data));
    }
  };
