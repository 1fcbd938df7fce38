//! Several questions at once, each with an answer of its own.

/// Answers those questions that are no error yet, all at once, and puts each answer where its question was.
///
/// `answer` gives as many answers as it gets questions, in their order.
pub(crate) fn answer_good<Q, A, E>(
    questions: Vec<Result<Q, E>>,
    answer: impl FnOnce(Vec<Q>) -> Vec<Result<A, E>>,
) -> Vec<Result<A, E>> {
    let mut good = Vec::new();
    let places: Vec<Result<(), E>> = questions.into_iter().map(|question| question.map(|it| good.push(it))).collect();
    let mut answers = answer(good).into_iter();
    let places = places.into_iter();
    places.filter_map(|place| place.map_or_else(|error| Some(Err(error)), |()| answers.next())).collect()
}

#[cfg(test)]
mod tests {
    use super::answer_good;

    #[test]
    fn each_answer_is_where_its_question_was() {
        let answered = answer_good(vec![Err("a"), Ok(1), Err("b"), Ok(2), Ok(3)], |good| {
            good.into_iter().map(|number| if number == 2 { Err("two") } else { Ok(number * 10) }).collect()
        });
        assert_eq!(answered, [Err("a"), Ok(10), Err("b"), Err("two"), Ok(30)]);
    }
}
