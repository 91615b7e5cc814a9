// The forms of the page of studies: a chosen field proposes its range, and says what it is now and what is allowed.
for (const fieldset of document.querySelectorAll("fieldset.axis")) {
  const field = fieldset.querySelector("select[name^=field]");
  if (!field) continue;
  const part = (name) => fieldset.querySelector(`[name^=${name}]`);
  const say = () => {
    const { now, allowed, choice } = field.selectedOptions[0].dataset;
    fieldset.querySelector(".allowed").textContent = now === undefined ? "" :
      choice ? `Now ${now}; ticked words are compared.` : `Now ${now}; allowed: ${allowed}.`;
    for (const input of fieldset.querySelectorAll("label > input:not([name^=words])")) {
      input.disabled = !field.value || Boolean(choice);
      input.parentElement.hidden = Boolean(choice);
    }
    for (const group of fieldset.querySelectorAll(".words")) {
      group.hidden = group.dataset.field !== field.value;
      for (const box of group.querySelectorAll("input")) box.disabled = group.hidden;
    }
  };
  field.addEventListener("change", () => {
    const { low = "", high = "", log } = field.selectedOptions[0].dataset;
    part("low").value = low;
    part("high").value = high;
    part("log").checked = Boolean(log);
    say();
  });
  say();
}
const source = document.getElementById("source");
source.querySelector("button").hidden = true;
source.querySelector("select").addEventListener("change", () => source.requestSubmit());
