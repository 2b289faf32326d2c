#pragma once
// Runs of EVT3 words without a turn of the time. All arrays are contiguous; callers see to the room.

// EVT3: rows, pixels and low times up to the first other word, or a low time behind `latest`. Changes low time and row in
// the state; out[1] = events. Returns the word to go on with.
static const auto run_of_evt3 = [](const auto& words, int at, int end, wp::int64 since, int high, int latest, int first,
    const auto& to) {
    wp::uint64 kept[RUN];
    int i = at, n = 0;
    const int stop = end - at < RUN ? end : at + RUN;
    const wp::uint32 same = TIME_HIGH << 12 | wp::uint32(high);
    wp::uint32 low = wp::uint32(to.state.data[LOW]), row = wp::uint32(to.state.data[ROW]);
    // rows, pixels and times follow each other in an order that no processor can guess: no branches on them
    while (i < stop && low <= wp::uint32(latest)) {
        const wp::uint32 word = words.data[i], kind = word >> 12, value = word & 0xFFF;
        if (__builtin_unpredictable((OTHER_KINDS >> kind & 1) & (word != same))) break;
        kept[n] = wp::uint64(low) << 32 | row << 16 | value;
        n += kind == ADDR_X;
        low = kind == TIME_LOW ? value : low;
        row = kind == ADDR_Y ? value & ADDRESS : row;
        ++i;
    }
    to.state.data[LOW] = low;
    to.state.data[ROW] = row;
    for (int k = 0; k < n; ++k) {
        to.t.data[first + k] = (since + wp::int64(kept[k] >> 32)) * 1000;
        to.x.data[first + k] = kept[k] & ADDRESS;
        to.y.data[first + k] = kept[k] >> 16 & ADDRESS;
        to.p.data[first + k] = kept[k] >> 11 & 1;
    }
    to.out.data[1] = first + n;
    return i;
};
