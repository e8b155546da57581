"""The cache that is limited in bytes."""

import random
import threading

from tcfit_app.analysis.byte_cache import ByteCache


def cache_of(limit: int) -> ByteCache[bytes]:
    return ByteCache(limit, len)


def test_what_was_asked_for_longest_ago_goes_first():
    cache = cache_of(30)
    for key in "abc":
        cache.put(key, bytes(10))
    assert cache.get("a") is not None
    cache.put("d", bytes(15))
    assert ["a" in cache, "b" in cache, "c" in cache, "d" in cache] == [True, False, False, True]
    cache.put("large", bytes(31))
    assert cache.used == 25 and len(cache) == 2, "what is too large drops no other"


def test_many_threads_leave_the_count_right():
    cache = cache_of(500)

    def work(seed: int) -> None:
        draw = random.Random(seed)
        for _ in range(2000):
            key = draw.randrange(40)
            if cache.get(key) is None:
                cache.put(key, bytes(draw.randrange(1, 60)))

    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    left = [len(value) for key in range(40) if (value := cache.get(key)) is not None]
    assert cache.used == sum(left) <= 500 and len(cache) == len(left)
