// One page of the scope in a headless Chromium until SIGTERM:  node bench/scope_memory_page.mjs ADDRESS PICTURE
import { Browser } from '../tests/scope/browser.mjs';

const [address, picture] = process.argv.slice(2);
const browser = await Browser.open(address);
await browser.until('curves', "scope.feed.series.get('estimate.omega_m_rad_s')?.max.length > 20", 300);
process.on('SIGTERM', async () => {
  console.log(`the page: ${await browser.evaluate("`tick ${scope.state.brief.last_k}, ${scope.feed.skipped} ticks not streamed, JavaScript heap ${(performance.memory.usedJSHeapSize / 2 ** 20).toFixed(1)} MiB`")}; its errors: ${browser.errors.length}`);
  await browser.picture(picture);
  await browser.close();
  process.exit(0);
});
