"""A connection that delays the messages of the server."""

import asyncio
import threading
import time


class Delay:
    """A proxy to the port `to`, on a port of its own. `seconds` is how late whatever the server says
    arrives; it may change at any time, and nothing overtakes what was said before."""

    def __init__(self):
        self.seconds, self.to = 0.0, None
        self.loop = asyncio.new_event_loop()
        self.started = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()
        assert self.started.wait(10)

    def run(self):
        asyncio.set_event_loop(self.loop)
        self.listener = self.loop.run_until_complete(asyncio.start_server(self.serve, "127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self.listener.sockets[0].getsockname()[1]}"
        self.started.set()
        self.loop.run_forever()

    async def serve(self, reader, writer):
        from_server, to_server = await asyncio.open_connection("127.0.0.1", self.to)
        await asyncio.gather(
            self.pump(reader, to_server, lambda: 0.0), self.pump(from_server, writer, lambda: self.seconds)
        )

    async def pump(self, reader, writer, delay):
        held = asyncio.Queue()
        taking = asyncio.ensure_future(self.take(reader, held))
        try:
            while True:
                came, data = await held.get()
                while (left := came + delay() - time.monotonic()) > 0:
                    await asyncio.sleep(min(left, 0.02))
                if not data:
                    break
                writer.write(data)
                await writer.drain()
        except OSError:
            pass
        finally:
            taking.cancel()
            writer.close()

    @staticmethod
    async def take(reader, held):
        data = b"?"
        while data:
            try:
                data = await reader.read(65536)
            except OSError:
                data = b""
            held.put_nowait((time.monotonic(), data))

    def close(self):
        async def end():
            self.listener.close()
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)

        asyncio.run_coroutine_threadsafe(end(), self.loop).result(10)
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join(10)
