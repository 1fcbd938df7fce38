//! The loader's order, content, endings and failures.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use farsight_data::{ItemKey, Loader, LoaderConfig, LoaderError, Position};
use proptest::prelude::*;
use rand::RngExt;

#[derive(Debug, thiserror::Error)]
#[error("bad item")]
struct BadItem;

type Drawn = (ItemKey, u64);

fn config() -> LoaderConfig {
    LoaderConfig {
        items: 23,
        batch_size: 4,
        seed: 9,
        shuffle: true,
        drop_last: false,
        workers: 2,
        prefetch: 2,
        start: Position::default(),
        epochs: Some(3),
    }
}

/// Some work that takes unequal time, so that workers overtake each other.
#[expect(clippy::unnecessary_wraps, reason = "the loader asks for a result")]
fn draw(key: ItemKey) -> Result<Drawn, BadItem> {
    let mut rng = key.rng();
    std::thread::sleep(Duration::from_micros(rng.random_range(0..300)));
    Ok((key, rng.random()))
}

fn everything(config: &LoaderConfig) -> Vec<(Position, Vec<Drawn>)> {
    let loader = Loader::new(config, draw).unwrap();
    loader.map(|batch| batch.map(|batch| (batch.position, batch.items)).unwrap()).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn neither_workers_nor_the_start_change_what_comes(
        items in 1_usize..40, batch_size in 1_usize..7, workers in 1_usize..5, prefetch in 1_usize..4,
        shuffle in any::<bool>(), drop_last in any::<bool>(), seed in any::<u64>(), resume in 0_usize..60,
    ) {
        let one = LoaderConfig { items, batch_size, seed, shuffle, drop_last, workers: 1, prefetch: 1, ..config() };
        prop_assume!(!drop_last || items >= batch_size);
        let expected = everything(&one);
        let many = LoaderConfig { workers, prefetch, ..one.clone() };
        prop_assert_eq!(&everything(&many), &expected);
        let resume = resume % expected.len();
        let resumed = LoaderConfig { start: expected[resume].0, ..many };
        prop_assert_eq!(&everything(&resumed)[..], &expected[resume..]);
    }
}

#[test]
fn every_epoch_has_every_item_once_in_its_own_order() {
    let batches = everything(&config());
    let epoch = |number| {
        let of_epoch = batches.iter().filter(move |(position, _)| position.epoch == number);
        of_epoch.flat_map(|(_, items)| items.iter().map(|(key, _)| key.index)).collect::<Vec<_>>()
    };
    let orders: Vec<_> = (0..3).map(epoch).collect();
    for order in &orders {
        assert_eq!(order.len(), 23);
        assert_eq!(order.iter().copied().collect::<BTreeSet<_>>(), (0..23).collect());
    }
    assert!(orders[0] != orders[1] && orders[1] != orders[2]);
    let drawn: BTreeSet<_> = batches.iter().flat_map(|(_, items)| items.iter().map(|(_, value)| *value)).collect();
    assert_eq!(drawn.len(), 3 * 23, "every item of every epoch has its own randomness");
}

#[test]
fn without_shuffling_items_come_by_number_and_the_last_batch_is_short_or_dropped() {
    let kept = everything(&LoaderConfig { shuffle: false, epochs: Some(1), ..config() });
    let numbers: Vec<_> = kept.iter().flat_map(|(_, items)| items.iter().map(|(key, _)| key.index)).collect();
    assert_eq!(numbers, (0..23).collect::<Vec<_>>());
    assert_eq!(kept.last().unwrap().1.len(), 3);
    let dropped = everything(&LoaderConfig { drop_last: true, epochs: Some(1), ..config() });
    assert!(dropped.len() == 5 && dropped.iter().all(|(_, items)| items.len() == 4));
}

#[test]
fn the_end_of_an_epoch_is_the_start_of_the_next() {
    let at_end = LoaderConfig { start: Position { epoch: 1, batch: 6 }, ..config() };
    assert_eq!(everything(&at_end)[0].0, Position { epoch: 2, batch: 0 });
}

#[test]
fn a_bad_item_is_the_error_of_its_batch_and_the_next_batch_comes() {
    let in_order = LoaderConfig { shuffle: false, epochs: Some(1), ..config() };
    let loader = Loader::new(&in_order, |key| match key.index {
        5 => Err(BadItem),
        9 => panic!("item nine"),
        index => Ok(index),
    });
    let outcomes: Vec<_> =
        loader.unwrap().map(|batch| batch.map(|batch| batch.items).map_err(|e| e.to_string())).collect();
    assert_eq!(outcomes.len(), 6);
    assert_eq!(outcomes[0], Ok(vec![0, 1, 2, 3]));
    assert_eq!(outcomes[1], Err("item 5 of epoch 0: bad item".to_owned()));
    assert_eq!(outcomes[2], Err("item 9 of epoch 0: preparing it panicked: item nine".to_owned()));
    assert_eq!(outcomes[3], Ok(vec![12, 13, 14, 15]));
}

#[test]
fn no_more_is_prepared_than_the_prefetch_allows_and_dropping_stops_it() {
    let prepared = Arc::new(AtomicUsize::new(0));
    let counter = Arc::clone(&prepared);
    let endless = LoaderConfig { workers: 3, prefetch: 2, epochs: None, ..config() };
    let mut loader = Loader::new(&endless, move |key| {
        counter.fetch_add(1, Ordering::SeqCst);
        Ok::<_, BadItem>(key)
    })
    .unwrap();
    loader.next().unwrap().unwrap();
    std::thread::sleep(Duration::from_millis(50));
    assert_eq!(prepared.load(Ordering::SeqCst), 4 + 2 * 4, "one batch taken, two ahead");
    assert_eq!(loader.position(), Position { epoch: 0, batch: 1 });
    drop(loader);
    assert_eq!(Arc::strong_count(&prepared), 1, "the threads are gone");
}

#[test]
fn configurations_without_batches_are_refused() {
    let start = Position { epoch: 0, batch: 7 };
    let cases = [
        (LoaderConfig { items: 0, ..config() }, "items is 0; expected at least 1"),
        (LoaderConfig { batch_size: 0, ..config() }, "batch_size is 0; expected at least 1"),
        (LoaderConfig { workers: 0, ..config() }, "workers is 0; expected at least 1"),
        (LoaderConfig { prefetch: 0, ..config() }, "prefetch is 0; expected at least 1"),
        (
            LoaderConfig { items: 3, drop_last: true, ..config() },
            "3 items make no full batch of 4; expected more items, a smaller batch, or incomplete batches kept",
        ),
        (
            LoaderConfig { start, ..config() },
            "start is batch 7 of its epoch; expected at most 6, the number of batches in an epoch",
        ),
    ];
    for (config, expected) in cases {
        let error: LoaderError = Loader::new(&config, draw).err().unwrap();
        assert_eq!(error.to_string(), expected);
    }
}
