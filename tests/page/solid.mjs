// An arm with a peg before a hole, as solids: the slave tells the joints of its arm. Throws at the first step that fails.
import { page, pause, run, takePicture, text, until } from './chromium.mjs';

await run(async () => {
  await until('both sides wait for a hand', async () => (await text('slave-mode')) === 'slave: waiting for a hand');
  await until('six axes are drawn as solids', async () => (await page.locator('#picture').getAttribute('data-solid')) === 'true');
  const told = await page.evaluate(async () => {
    const socket = new WebSocket(`ws://${location.host}/live`);
    socket.binaryType = 'arraybuffer';
    let scene = null;
    const sample = await new Promise((done) => {
      socket.onmessage = ({ data }) => {
        if (typeof data === 'string') scene ??= JSON.parse(data);
        else if (data.byteLength > 0) done(new Float64Array(data));
      };
    });
    socket.close();
    let at = 0;
    for (const [name, size] of scene.fields) {
      if (name === 'joint_rad') break;
      at += size;
    }
    return { joints: scene.arm.joints.length, profile: scene.environment[0].profile_m, position: Array.from(sample.slice(at, at + 7)) };
  });
  console.log(`joints at ${told.position.map((q) => q.toFixed(3)).join(' ')} rad`);
  if (told.joints !== 7) throw new Error(`the arm has ${told.joints} joints`);
  if (told.profile.length !== 4) throw new Error('the hole has another profile');
  if (!(Math.abs(told.position[1] + 0.785) < 0.2 && Math.abs(told.position[3] + 2.356) < 0.2)) throw new Error('the arm stands otherwise');
  await page.locator('#fit').click();
  await pause(2000);
  await takePicture();
});
