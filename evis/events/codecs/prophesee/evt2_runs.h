#pragma once
// Runs of EVT2 words without a turn of the time. All arrays are contiguous; callers see to the room.

// EVT2: events up to the first other word. Returns the word to go on with.
static const auto run_of_evt2 = [](const auto& words, int at, int end, wp::int64 since, int first, const auto& to) {
    int i = at;
    while (i < end && words.data[i] >> (TYPE_SHIFT + 1) == 0) ++i;
    for (int k = 0; k < i - at; ++k) {
        const wp::uint32 word = words.data[at + k];
        to.t.data[first + k] = (since + wp::int64(word >> LOW_SHIFT & LOW_MASK)) * 1000;
        to.x.data[first + k] = word >> X_SHIFT & ADDRESS;
        to.y.data[first + k] = word & ADDRESS;
        to.p.data[first + k] = word >> TYPE_SHIFT;
    }
    return i;
};
