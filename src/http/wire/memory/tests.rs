use super::*;

const MB: u64 = 1 << 20;

fn budget(bytes: u64, patience: Duration) -> MemoryBudget {
    MemoryBudget::new(bytes, patience)
}

/// A body of a known length, of which `bytes` are there.
fn of(bytes: u64, length: u64) -> Arrival {
    Arrival { bytes, left: Some(length - bytes), is_slow: false }
}

fn whole(bytes: u64) -> Arrival {
    of(bytes, bytes)
}

#[tokio::test]
async fn bodies_take_five_times_what_has_come_and_give_it_back() {
    let memory = budget(80 * MB, Duration::ZERO);
    let mut held = memory.begin(Owner::nobody());
    held.grow(of(2 * MB, 1000 * MB)).await.unwrap();
    assert_eq!(memory.taken(), 10 * MB, "whatever is announced");
    held.grow(of(4 * MB, 5 * MB)).await.unwrap();
    assert_eq!(memory.taken(), 20 * MB);
    held.arrived(3 * MB);
    assert_eq!(memory.taken(), 15 * MB);
    held.keep(7 * MB);
    assert_eq!(memory.taken(), 7 * MB, "what is left of it once it is read");
    held.keep(9 * MB);
    assert_eq!(memory.taken(), 7 * MB);
    drop(held);
    assert_eq!(memory.taken(), 0);
}

#[tokio::test]
async fn a_body_waits_for_room_and_is_told_when_there_is_none() {
    let memory = budget(80 * MB, Duration::from_mins(1));
    let mut first = memory.begin(Owner::nobody());
    first.grow(whole(15 * MB)).await.unwrap();
    let mut second = memory.begin(Owner::nobody());
    let mut waiting = Box::pin(second.grow(whole(2 * MB)));
    assert!(futures_util::poll!(&mut waiting).is_pending());
    drop(first);
    waiting.await.unwrap();

    let impatient = budget(80 * MB, Duration::ZERO);
    let mut first = impatient.begin(Owner::nobody());
    first.grow(whole(15 * MB)).await.unwrap();
    let refused = impatient.begin(Owner::nobody()).grow(whole(2 * MB)).await.unwrap_err();
    assert_eq!(refused.kind(), Kind::Unavailable);
}

#[tokio::test]
async fn a_body_that_will_never_have_room_is_too_large() {
    let memory = budget(80 * MB, Duration::from_mins(1));
    let refused = memory.begin(Owner::nobody()).grow(whole(16 * MB + 1)).await.unwrap_err();
    assert_eq!(refused.kind(), Kind::TooLarge);
    memory.begin(Owner::nobody()).grow(whole(16 * MB)).await.unwrap();
}

#[tokio::test]
async fn small_bodies_have_a_part_of_their_own_unless_they_are_slow() {
    let memory = budget(80 * MB, Duration::ZERO);
    let mut large = memory.begin(Owner::nobody());
    large.grow(whole(16 * MB)).await.unwrap();
    let mut small: Vec<_> = (0..2).map(|_| memory.begin(Owner::nobody())).collect();
    for one in &mut small {
        one.grow(whole(MB)).await.unwrap();
    }
    let mut third = memory.begin(Owner::nobody());
    assert!(third.grow(whole(MB)).await.is_err(), "the part is 10 MB");
    let slow = Arrival { is_slow: true, ..whole(MB) };
    assert!(small[0].grow(slow).await.is_err(), "the slow have to find room elsewhere");
    drop(large);
    small[0].grow(slow).await.unwrap();
    third.grow(whole(MB)).await.unwrap();
    assert_eq!(memory.taken(), 15 * MB);
}

#[tokio::test]
async fn who_waits_for_much_is_not_in_the_way_of_who_needs_little() {
    let memory = budget(80 * MB, Duration::from_mins(1));
    let mut first = memory.begin(Owner::nobody());
    first.grow(whole(8 * MB)).await.unwrap();
    let mut large = memory.begin(Owner::nobody());
    let mut waiting = Box::pin(large.grow(whole(12 * MB)));
    assert!(futures_util::poll!(&mut waiting).is_pending());
    let mut later = memory.begin(Owner::nobody());
    later.grow(whole(3 * MB)).await.unwrap();
    drop((first, later));
    waiting.await.unwrap();
}

#[tokio::test]
async fn bodies_that_grow_together_do_not_wait_for_each_other_for_ever() {
    let memory = budget(40 * MB, Duration::from_mins(1));
    let length = 3 * MB;
    let bodies = (0..20).map(|_| {
        let memory = memory.clone();
        tokio::spawn(async move {
            let mut held = memory.begin(Owner::nobody());
            for sixteenth in 1..=16 {
                held.grow(of(length * sixteenth / 16, length)).await.unwrap();
                tokio::task::yield_now().await;
            }
        })
    });
    for body in bodies.collect::<Vec<_>>() {
        body.await.unwrap();
    }
    assert_eq!(memory.taken(), 0);
}

#[tokio::test]
async fn no_named_owner_holds_more_than_half() {
    let memory = budget(80 * MB, Duration::ZERO);
    let (lab, other) = (Owner::named("lab"), Owner::named("other"));
    let mut first = memory.begin(lab.clone());
    first.grow(whole(11 * MB)).await.unwrap();
    assert!(memory.reserve(lab.clone(), 10 * MB).await.is_err());
    let mut second = memory.begin(lab.clone());
    assert!(second.grow(whole(2 * MB)).await.is_err());
    let answer = memory.reserve(other.clone(), 40 * MB).await.unwrap();
    drop(first);
    second.grow(whole(2 * MB)).await.unwrap();
    drop((second, answer));
    assert_eq!(memory.taken(), 0);
    assert!(memory.lock().owners.is_empty());
}

#[tokio::test]
async fn answers_wait_for_each_other_and_are_told_when_it_takes_too_long() {
    let memory = budget(80 * MB, Duration::from_mins(1));
    let first = memory.reserve(Owner::nobody(), 60 * MB).await.unwrap();
    assert!(memory.try_reserve(Owner::nobody(), 21 * MB).is_none());
    drop(memory.try_reserve(Owner::nobody(), 9 * MB).unwrap());
    let mut large = Box::pin(memory.reserve(Owner::nobody(), u64::MAX));
    assert!(futures_util::poll!(&mut large).is_pending());
    drop(first);
    drop(large.await.unwrap());
}

#[tokio::test]
async fn answers_leave_room_for_bodies_and_bodies_for_answers() {
    let memory = budget(80 * MB, Duration::ZERO);
    let answer = memory.reserve(Owner::nobody(), u64::MAX).await.unwrap();
    memory.begin(Owner::nobody()).grow(whole(6 * MB)).await.unwrap();
    drop(answer);
    let mut body = memory.begin(Owner::nobody());
    body.grow(whole(14 * MB)).await.unwrap();
    body.add(40 * MB).await.unwrap();
    assert_eq!(memory.taken(), 110 * MB);
    drop(body);
    assert_eq!(memory.taken(), 0);
}

#[tokio::test]
async fn a_reservation_is_kept_until_the_answer_is_sent() {
    let memory = budget(8 * MB, Duration::ZERO);
    let reservation = memory.reserve(Owner::nobody(), u64::MAX).await.unwrap();
    let answer = reservation.until_sent(Response::new(Body::from("numbers")));
    assert!(memory.try_reserve(Owner::nobody(), u64::MAX).is_none());
    assert_eq!(axum::body::to_bytes(answer.into_body(), 100).await.unwrap(), "numbers");
    assert_eq!(memory.taken(), 0);
}
